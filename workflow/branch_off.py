"""Lets jobs branch off from one process that has imported what they need, instead of each importing it.

python branch_off.py SOCKET MODULE ...: that process; it ends with its standard input. Followed by a job's command, a
Python script, instead of modules: runs it in a branch, or as it stands where nobody listens at the socket yet.
"""

import os
import runpy
import select
import signal
import socket
import sys
import threading
from contextlib import suppress


def serve(address: str, modules: list[str]) -> None:
    """Import the modules, then run scripts that are named at the socket, each in a branch of this process."""
    sys.path[1:1] = [os.path.dirname(sys.path[0])]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for module in modules:
        __import__(module)
    with suppress(ImportError):  # a third of a second that the first compiled function of each branch would take
        from numba.core.registry import cpu_target

        cpu_target.typing_context.refresh()
        cpu_target.target_context.refresh()
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(address)
        door.listen()
        while sys.stdin not in (waiting := select.select([door, sys.stdin], [], [])[0]):
            job, _ = waiting[0].accept()
            if not os.fork():
                branch(job)
            job.close()
    os.unlink(address)


def branch(job: socket.socket) -> None:
    """Run the script that the job names, and tell it the exit status; end with the job's process."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    script, status = job.recv(4096).decode(), 1
    threading.Thread(target=lambda: job.recv(1) or os._exit(1), daemon=True).start()
    try:
        runpy.run_path(script, run_name="__main__")
        status = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    sys.stdout.flush()
    job.send(bytes([status]))
    os._exit(status)


def run(address: str, command: list[str]) -> None:
    """Run the command's script in a branch; as it stands where another Python is to run it or nobody listens."""
    job = socket.socket(socket.AF_UNIX)
    if command[0] != sys.executable or len(command) != 2 or job.connect_ex(address):
        os.execvp(command[0], command)
    job.send(command[1].encode())
    sys.exit(*(job.recv(1) or b"\1"))


if __name__ == "__main__":
    (run if os.sep in sys.argv[2] else serve)(sys.argv[1], sys.argv[2:])
