"""Several stages in one job, with files between them: what a killed job has finished is not made again."""

import hashlib
import inspect
import json
import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from pinnochio.code import code_hash
from pinnochio.files import replacing


class Stages:
    """Runs stages unless their outputs are there and were made by the same code of the same inputs and settings.

    record: a file of hashes per stage beside the outputs, which is no output of the job itself. Outputs are compared
    too: after an error older ones may have been put back.
    """

    def __init__(self, record: str | os.PathLike):
        self._record = Path(record)
        self._made = json.loads(self._record.read_text("utf-8")) if self._record.is_file() else {}

    def __call__(
        self, stage: Callable, inputs: Mapping[str, object], outputs: Mapping[str, str], settings: Mapping[str, object]
    ) -> None:
        """Call `stage` with inputs, outputs and settings by the names of its arguments.

        inputs: files, folders, or several by name or in order; settings: values whose repr says all. Outputs that stay
        count as new, as the job's.
        """
        name = stage.__name__
        key = hashlib.sha256(
            repr((code_hash(inspect.getfile(stage)), sorted(settings.items()), _contents(inputs))).encode()
        ).hexdigest()
        if all(os.path.exists(path) for path in outputs.values()) and self._made.get(name) == [key, _contents(outputs)]:
            logging.info("%s: kept", name)
            for path in outputs.values():
                os.utime(path)
            return
        began = time.perf_counter()
        stage(**inputs, **outputs, **settings)
        logging.info("%s: %.1f s", name, time.perf_counter() - began)
        self._made[name] = [key, _contents(outputs)]
        with replacing(self._record) as temporary:
            temporary.write_text(json.dumps(self._made, indent=1) + "\n", "utf-8")


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
