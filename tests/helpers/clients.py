"""Clients of the planner's server: a request, and the framework's own messages over a WebSocket."""

import asyncio
import contextlib

import aiohttp
import msgpack


def ask(port, path, **headers):
    """Status, headers and text of a request."""

    async def get():
        jar = aiohttp.DummyCookieJar()
        async with (
            aiohttp.ClientSession(cookie_jar=jar) as session,
            session.get(f"http://127.0.0.1:{port}{path}", headers=headers, allow_redirects=False) as answer,
        ):
            return answer.status, answer.headers, await answer.text()

    return asyncio.run(get())


def hello(port, path, secret, **headers):
    """What the server answers to a client of the framework that asks for the state: what it said, or a status."""

    async def connect():
        async with aiohttp.ClientSession() as session:
            try:
                socket = await session.ws_connect(f"ws://127.0.0.1:{port}{path}", headers=headers)
            except aiohttp.WSServerHandshakeError as error:
                return error.status
            said = b""
            async with socket:
                for name, args in (("wslink.hello", [{"secret": secret}]), ("trame.state.get", [])):
                    kind = "system:c0:0" if name == "wslink.hello" else "rpc:c0:1"
                    message = msgpack.packb({"wslink": "1.0", "id": kind, "method": name, "args": args, "kwargs": {}})
                    head = b"".join(number.to_bytes(4, "little") for number in (1, 0, len(message)))
                    await socket.send_bytes(head + message)
                    with contextlib.suppress(asyncio.TimeoutError):
                        said += (await asyncio.wait_for(socket.receive(), 30)).data
            return said

    return asyncio.run(connect())
