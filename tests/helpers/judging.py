"""Tries inputs in a process of their own, one after the other, and says how each went."""

import json
import multiprocessing
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError

REFUSED = "refused"


@dataclass(frozen=True)
class Tried:
    """One input: act(folder) reads it and gives what it has read; right: what it must give if it is not refused, None
    where it must be refused, ... where any answer will do that `act` itself has judged."""

    name: str
    act: Callable[[Path], object]
    right: object = None


def same(one, other) -> bool:
    """Whether two readings agree: arrays element by element, in order."""
    if isinstance(one, dict):
        return isinstance(other, dict) and one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.shape == np.shape(other) and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return bool(one == other) or (one != one and other != other)


def judged(tried: Tried, folder: Path) -> str:
    """ "accepted" or "refused"; anything else is what is wrong."""
    try:
        read = tried.act(folder)
    except InputError as error:
        whole = error.case and error.file and min(len(error.problem), len(error.remedy)) > 5
        return REFUSED if whole else f"an error without case, file or remedy: {error}"
    except BaseException as error:
        return f"traceback: {type(error).__name__}: {str(error)[:200]}"
    if tried.right is ...:
        return "accepted"
    if tried.right is None:
        return "silent: accepted what is wrong"
    return "accepted" if same(tried.right, read) else "silent: another result"


def _work(inputs: Sequence[Tried], start: int, report: str) -> None:
    with open(report, "a", encoding="utf-8", buffering=1) as file:
        for tried in inputs[start:]:
            folder = Path(tempfile.mkdtemp())
            file.write(json.dumps([tried.name, judged(tried, folder)]) + "\n")
            shutil.rmtree(folder, ignore_errors=True)


def outcomes(inputs: Sequence[Tried], folder: Path) -> dict[str, str]:
    """What became of each input, by its name; one that ends the process is a "crash", and the next goes on."""
    report, context = folder / "report.jsonl", multiprocessing.get_context("fork")
    report.touch()
    done: list = []
    while len(done) < len(inputs):
        child = context.Process(target=_work, args=(inputs, len(done), str(report)))
        child.start()
        child.join()
        done = [json.loads(line) for line in report.read_text(encoding="utf-8").splitlines()]
        if len(done) < len(inputs):
            done.append([inputs[len(done)].name, f"crash: exit code {child.exitcode}"])
            report.write_text("".join(json.dumps(row) + "\n" for row in done), encoding="utf-8")
    result = dict(done)
    assert len(result) == len(inputs), "two inputs have one name"
    return result
