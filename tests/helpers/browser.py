"""The planner and its page in a headless Chromium, and what goes wrong on a page."""

import importlib.util
import os
import re
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import STDOUT, Popen

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
MISSING = [name for name in ("trame", "trame_vtk", "trame_vuetify", "playwright") if not importlib.util.find_spec(name)]
MISSING += [] if CHROMIUM else ["chromium (apt-get install chromium)"]
DRIVEN = [pytest.mark.full, pytest.mark.skipif(bool(MISSING), reason=f"the planner's test lacks {MISSING}")]

# A promise rejected with what is no Error is reported as "Object".
TELL = """addEventListener("unhandledrejection", (event) => {
    if (event.reason instanceof Error) return;
    event.preventDefault();
    setTimeout(() => { throw new Error(`rejected: ${JSON.stringify(event.reason)}`); });
});"""


@contextmanager
def chromium() -> Iterator:
    """A browser with WebGL without a graphics card; a container's root has no sandbox."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        yield play.chromium.launch(executable_path=CHROMIUM, args=["--enable-unsafe-swiftshader", "--no-sandbox"])


@contextmanager
def served(said: Path, start: Callable[..., Popen]) -> Iterator[str]:
    """Where the planner listens that `start` begins with options of Popen; what it says goes to the file `said`."""
    with open(said, "w") as stream:
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        process = start(env=environment, stdout=stream, stderr=STDOUT, start_new_session=True)
    while not (address := re.search(r"Local: +(http://\S+)", said.read_text())):
        assert process.poll() is None, said.read_text()[-4000:]
        time.sleep(0.5)
    yield address[1]
    os.killpg(process.pid, signal.SIGTERM)
    process.wait()


def uncaught(page) -> list[str]:
    """A list that the errors nobody caught on a page, which is not opened yet, will be added to."""
    errors = []
    page.add_init_script(TELL)
    page.on("pageerror", lambda error: errors.append(str(error)))
    return errors
