"""Sends what a stage script says, warns or raises to its log file."""

import logging
import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from pinnochio.files import check_writable


def attach_log(path: str) -> None:
    """Log to `path`: records, warnings, standard error (progress bars, compiled libraries) and an uncaught exception.

    Snakemake does not redirect a `script:` to its `log:`, hence this. The exception is also left on the
    terminal, because that is where the user looks first.
    """
    check_writable(path)
    stream = open(path, "w", buffering=1)  # noqa: SIM115 (lives as long as the process)
    terminal = os.fdopen(os.dup(2), "w", buffering=1)  # noqa: SIM115
    os.dup2(stream.fileno(), 2)  # what compiled libraries say, of a display that is not there
    logging.basicConfig(
        stream=stream, level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s", force=True
    )
    logging.captureWarnings(True)
    warnings.simplefilter("default")
    sys.stderr = stream

    def hook(kind, error, traceback):
        logging.getLogger("stage").critical("failed", exc_info=(kind, error, traceback))
        print(f"{kind.__name__}: {error}\n(log: {path})", file=terminal)

    sys.excepthook = hook


@contextmanager
def collected() -> Iterator[list[str]]:
    """What the library warns of in the block, each once, without the name of the case."""
    said: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            words = re.sub(r"^case '[^']*': ", "", record.getMessage())
            said.extend([words] if words not in said else [])

    handler = Collector(logging.WARNING)
    logging.getLogger("pinnochio").addHandler(handler)
    try:
        yield said
    finally:
        logging.getLogger("pinnochio").removeHandler(handler)


def warnings_in(path: str) -> list[str]:
    """What the library warned of in a stage's log file; nothing where there is none."""
    lines = [line for line in _lines(path) if re.match(r"\S+ \S+ WARNING pinnochio\.", line)]
    return [line.split(": ", 1)[1].strip() for line in lines]


def last_line(path: str) -> str:
    """The last line of a log file, which says why a stage has failed; nothing where there is none."""
    return ["", *filter(None, map(str.strip, _lines(path)))][-1]


def _lines(path: str) -> list[str]:
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.readlines()
    except OSError:
        return []
