"""What goes wrong on a page in a browser."""

# A promise rejected with what is no Error is reported as "Object".
TELL = """addEventListener("unhandledrejection", (event) => {
    if (event.reason instanceof Error) return;
    event.preventDefault();
    setTimeout(() => { throw new Error(`rejected: ${JSON.stringify(event.reason)}`); });
});"""


def uncaught(page) -> list[str]:
    """A list that the errors nobody caught on a page, which is not opened yet, will be added to."""
    errors = []
    page.add_init_script(TELL)
    page.on("pageerror", lambda error: errors.append(str(error)))
    return errors
