"""Who can reach the planner's server: a real one, with clients of foreign Origin, Host and secret."""

import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import pytest

from pinnochio.errors import InputError
from studies.planner import serving
from tests.helpers.clients import ask, hello
from tests.helpers.settings import ROOT

SERVER = """
import os
import sys
from trame.app import get_server
from trame.ui.html import DivLayout
from pinnochio.errors import InputError
from studies.planner.serving import serve
server = get_server("guarded")
server.state.patient = "P01"
with DivLayout(server):
    pass
try:
    serve(server, 0, "BROWSER" in os.environ)
except InputError as error:
    sys.exit(str(error))
"""


def start(folder, **environment):
    (folder / "server.py").write_text(SERVER)
    environment = {key: value for key, value in os.environ.items() if key != "TRAME_ARGS"} | environment
    environment |= {"PYTHONPATH": str(ROOT / "workflow"), "PYTHONUNBUFFERED": "1"}
    return subprocess.Popen(
        [sys.executable, "server.py"], cwd=folder, env=environment, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip


@contextmanager
def saying(folder, pattern, **environment):
    """A server that runs until the block ends; what it says first that matches."""
    process, said = start(folder, **environment), ""
    while not (match := re.search(pattern, said)):
        line = process.stdout.readline()
        assert line, said
        said += line
    yield match
    os.killpg(process.pid, signal.SIGTERM)
    process.wait()


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """Port and secret of a server."""
    with saying(tmp_path_factory.mktemp("server"), r"Local: +http://127\.0\.0\.1:(\d+)/\?secret=(\S+)") as address:
        yield int(address[1]), address[2]


def test_who_has_the_address_gets_page_and_state(address):
    port, secret = address
    status, headers, _ = ask(port, f"/?secret={secret}")
    assert status == 302 and headers["Location"].startswith("index.html?secret=")
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie and secret in cookie
    status, headers, text = ask(port, f"/index.html?secret={secret}")
    assert status == 200 and "<html" in text and "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    header = {"Cookie": f"planner{port}={secret}"}
    assert ask(port, "/vue.global.js", **header)[0] == 200
    assert ask(port, "/index.html", **header)[1]["Location"] == f"/index.html?secret={secret}"  # loaded again
    assert b"P01" in hello(port, "/ws", secret, Origin=f"http://127.0.0.1:{port}", **header)
    assert b"P01" in hello(port, "/ws", secret, Origin=f"http://localhost:{port}", Host=f"localhost:{port}", **header)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}", ""]
)
def test_a_page_of_another_origin_reaches_nothing(address, origin):
    port, secret = address
    header = {"Cookie": f"planner{port}={secret}", "Origin": origin.format(port=port)}
    assert hello(port, "/ws", secret, **header) == 403
    assert ask(port, f"/index.html?secret={secret}", **header)[0] == 403


@pytest.mark.parametrize(
    "host", ["evil.example:{port}", "evil.example", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil:{port}"]
)
def test_a_foreign_name_that_leads_here_reaches_nothing(address, host):
    port, secret = address
    host = host.format(port=port)
    header = {"Cookie": f"planner{port}={secret}", "Host": host, "Origin": f"http://{host}"}
    assert hello(port, "/ws", secret, **header) == 403
    assert ask(port, f"/?secret={secret}", Host=host)[0] == 403


@pytest.mark.parametrize("secret", ["wslink-secret", "", "s", "é"])
def test_who_guesses_the_secret_reaches_nothing(address, secret):
    port, right = address
    assert hello(port, f"/ws?secret={secret}", secret) == 403
    assert ask(port, f"/?secret={secret}")[0] == 403 and ask(port, "/")[0] == 403
    assert ask(port, "/", Cookie=f"planner{port + 1}={right}")[0] == 403  # of another planner
    said = hello(port, f"/ws?secret={right}", secret)  # past the door, and refused by the framework
    assert b"Authentication failed" in said and b"P01" not in said


def test_the_secret_is_another_one_at_every_start(address, tmp_path):
    with saying(tmp_path, r"secret=(\S+)") as again:
        assert again[1] != address[1] and len(again[1]) > 40


@pytest.mark.parametrize("args", ["--host 0.0.0.0", "--authKey known", "--reverse-url ws://evil.example"])
def test_no_option_of_the_framework_changes_that(tmp_path, args):
    process = start(tmp_path, TRAME_ARGS=args)
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 1 and "unset TRAME_ARGS" in said and "Local" not in said


def test_the_browser_is_opened_at_the_address(tmp_path):
    local = r"(?s)Local: +(http://127\.0\.0\.1:\d+/\?secret=\S+).*opened (\S+)\n"
    with saying(tmp_path, local, BROWSER="echo opened %s") as said:
        assert said[1] == said[2]


def test_only_the_loopback_is_listened_on(address):
    for place in ("127.0.0.2", socket.gethostbyname(socket.gethostname())):
        if place != "127.0.0.1":
            with socket.socket() as probe, pytest.raises(OSError):
                probe.settimeout(5)
                probe.connect((place, address[0]))


def test_a_port_in_use_is_said_with_a_remedy(address):
    with pytest.raises(InputError, match="in use.*--port 0"):
        serving.check_free(address[0])
    with pytest.raises(InputError, match="--port 0"):
        serving.check_free(70000)
    serving.check_free(0)
