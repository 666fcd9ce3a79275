"""What a call costs in a process of its own: seconds, processor seconds, memory, or why it did not end."""

import importlib
import json
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

DONE = "done"
SHORT = 5.0  # s; a call that is over sooner is made once more, and the faster one counts


@dataclass(frozen=True)
class Cost:
    """seconds and cpu_seconds of the call; start_seconds until its process and modules were there; memory: peak of the
    process, MB; outcome: DONE, or why there is no number."""

    outcome: str
    seconds: float = np.nan
    cpu_seconds: float = np.nan
    start_seconds: float = np.nan
    memory: float = np.nan


def measure(function: str, arguments: Mapping, limit: float) -> Cost:
    """Call the function "module:name" in a new process, which is ended after `limit` seconds.

    A function that returns a pair (seconds, processor seconds) speaks for itself.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__],
            input=pickle.dumps((function, dict(arguments), time.time())),
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            timeout=limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Cost(f"stopped: time limit of {limit:g} s")
    if done.returncode:
        return Cost(f"ended: by the system, exit code {done.returncode}")
    return Cost(**json.loads(done.stdout.splitlines()[-1]))


def answer(function: str, arguments: Mapping, began: float) -> Cost:
    """What measure asks of the new process; `began`: time.time() when it was asked."""
    try:
        module, name = function.split(":")
        called = getattr(importlib.import_module(module), name)
        start = time.time() - began
        seconds = _timed(called, arguments)
        if seconds[0] < SHORT:
            seconds = min(seconds, _timed(called, arguments))
    except Exception as error:  # whatever stops a stage belongs into its table
        return Cost(f"failed: {type(error).__name__}: {error}".splitlines()[0])
    return Cost(DONE, *seconds, start, peak_memory())


def _timed(called, arguments) -> tuple[float, float]:
    seconds, cpu = time.perf_counter(), time.process_time()
    own = called(**arguments)
    return own or (time.perf_counter() - seconds, time.process_time() - cpu)


def peak_memory() -> float:
    """Peak resident memory of this process in MB, NaN where the system does not say.

    Not that of getrusage, which begins with that of the parent.
    """
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
    except OSError:
        return np.nan
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


if __name__ == "__main__":
    print(json.dumps(asdict(answer(*pickle.load(sys.stdin.buffer)))))
