"""Several stages in one job, with files between them: what a killed job has finished is not made again."""

import hashlib
import inspect
import json
import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from pinnochio.code import called, code_hash
from pinnochio.files import replacing


class Stages:
    """Runs stages unless their outputs are there and were made by the same code of the same inputs and settings.

    record: a file of hashes and seconds per stage beside the outputs, which is no output of the job itself. Outputs are
    compared too: after an error older ones may have been put back.
    """

    def __init__(self, record: str | os.PathLike):
        self._record = Path(record)
        self._made = json.loads(self._record.read_text("utf-8")) if self._record.is_file() else {}

    def __call__(
        self, stage: Callable, inputs: Mapping[str, object], outputs: Mapping[str, str], settings: Mapping[str, object]
    ) -> None:
        """Call `stage` with inputs, outputs and settings by the names of its arguments.

        inputs: files, folders, or several by name or in order; settings: values whose repr says all, modules that are
        called by name too. Outputs that stay count as new, as the job's.
        """
        name, said = self.name(stage, outputs), repr(sorted(settings.items()))
        code = code_hash(inspect.getfile(stage), *called(said))
        key = hashlib.sha256(repr((code, said, _contents(inputs))).encode()).hexdigest()
        there, made = all(map(os.path.exists, outputs.values())), self._made.get(name, [])
        if there and made[:2] == [key, _contents(outputs)]:
            logging.info("%s: kept", name)
            for path in outputs.values():
                os.utime(path)
            return
        began = time.perf_counter()
        stage(**inputs, **outputs, **settings)
        seconds = round(time.perf_counter() - began, 3)
        logging.info("%s: %.1f s", name, seconds)
        self._made[name] = [key, _contents(outputs), seconds]
        with replacing(self._record) as temporary:
            temporary.write_text(json.dumps(self._made, indent=1) + "\n", "utf-8")

    def name(self, stage: Callable, outputs: Mapping[str, str]) -> str:
        """The stage's name with its outputs, which say which of several calls it is."""
        return " ".join([stage.__name__, *(os.path.relpath(path, self._record.parent) for path in outputs.values())])


def seconds_of(record: str | os.PathLike) -> dict[str, float]:
    """What each stage of a record took, when it was made."""
    made = json.loads(Path(record).read_text("utf-8"))
    return {name.split()[0]: seconds for name, (*_, seconds) in made.items()}


def _contents(named: Mapping[str, object]) -> str:
    """Hash of files by the names of arguments."""
    digest = hashlib.sha256()
    for name, value in sorted(named.items()):
        for file in _files(value):
            digest.update(repr((name, file.name, hashlib.sha256(file.read_bytes()).hexdigest())).encode())
    return digest.hexdigest()


def _files(value) -> Iterator[Path]:
    if isinstance(value, str):
        path = Path(value)
        yield from sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    elif value is not None:
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from _files(each)
