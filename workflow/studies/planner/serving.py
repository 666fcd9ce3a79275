"""The planner's server: on this machine alone, and for nobody but who was given its address.

Any page in the same browser can open a connection to 127.0.0.1, and a foreign name can be made to lead there. So every
request must name the server itself (Host), come from its own pages (Origin), and bear the secret of this start: in the
address that is printed, afterwards in a cookie.
"""

import asyncio
import os
import secrets
import socket
import webbrowser

from aiohttp import web
from trame_server.core import Server

from pinnochio.errors import InputError

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
COOKIE = "planner"
PAGES = ("/", "/index.html")
HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
}
REFUSED = "Refused: open the address that the planner printed when it was started; it is for this machine alone."


def check_free(port: int) -> None:
    """InputError where nothing can listen on a port of the loopback; 0 stands for any that is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "it is none"
            raise InputError("-", f"port {port}", reason.lower(), "choose another with --port, or --port 0") from error


def serve(server: Server, port: int, browser: bool) -> None:
    """Listen on the loopback until the process is ended; prints the address with its secret.

    InputError where the port is taken, or where the environment asks the framework for something else.
    """
    if os.environ.get("TRAME_ARGS"):
        raise InputError("-", "TRAME_ARGS", "it could open the planner to other machines", "unset TRAME_ARGS")
    check_free(port)
    secret = "s" + secrets.token_hex(24)  # a letter first: what looks like a number the page would read as one
    server.cli.set_defaults(authKey=secret, host=LOOPBACK)

    def bind(bound) -> None:
        if bound.host != LOOPBACK:
            raise InputError("-", f"host {bound.host}", "the planner is for this machine alone", "give no host")
        bound.app.middlewares.append(guard(secret))

    def ready(**_) -> None:
        address = f"http://{LOOPBACK}:{server.port}/?secret={secret}"
        print(f"\nThe planner is open, for this machine alone. Ctrl-C ends it.\n - Local:   {address}\n", flush=True)
        if browser:
            asyncio.get_running_loop().call_later(0.1, lambda: webbrowser.open(address))

    server.controller.on_server_bind.add(bind)
    server.controller.on_server_ready.add(ready)
    server.start(host=LOOPBACK, port=port, open_browser=False, show_connection_info=False, timeout=0)


def guard(secret: str):
    """What every request has to pass: its Host, its Origin if it has one, and the secret."""

    @web.middleware
    async def passes(request: web.Request, handler):
        port = request.transport.get_extra_info("sockname")[1] if request.transport else None
        hosts = [f"{name}:{port}" for name in NAMES]
        cookie = f"{COOKIE}{port}"  # ports of one machine share their cookies
        origin, sent = request.headers.get("Origin"), request.query.get("secret")
        if (
            request.headers.getall("Host", [])[1:]
            or request.headers.get("Host") not in hosts
            or (origin is not None and origin not in [f"http://{host}" for host in hosts])
            or not (_same(sent, secret) or _same(request.cookies.get(cookie), secret))
        ):
            raise web.HTTPForbidden(text=REFUSED)
        try:
            if request.path in PAGES and sent is None:  # loaded again: the page needs the secret for itself
                raise web.HTTPFound(f"/index.html?secret={secret}")
            response = await handler(request)
        except web.HTTPException as other:  # a redirection among them
            response = other
        if not response.prepared:
            response.headers.update(HEADERS)
            if sent is not None:
                response.set_cookie(cookie, secret, httponly=True, samesite="Strict")
        if isinstance(response, web.HTTPException):
            raise response
        return response

    return passes


def _same(sent: str | None, secret: str) -> bool:
    return sent is not None and secrets.compare_digest(sent.encode(), secret.encode())
