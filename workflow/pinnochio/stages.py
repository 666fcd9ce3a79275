"""Several stages in one job, with files between them: what a job that ended early has finished is not made again."""

import hashlib
import inspect
import json
import logging
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from pinnochio.code import called, code_hash, source_file
from pinnochio.files import replacing
from pinnochio.json_text import write_json
from pinnochio.references import resolve


class Stages:
    """Runs stages unless their outputs are there and were made by the same code of the same inputs and settings.

    record: a file of hashes and seconds per stage beside the outputs, which is no output of the job itself. Of a job
    that ends with an error, or is killed for its memory, Snakemake deletes the outputs, or puts older ones back: as a
    context, copies lie in a folder beside the record until the job has ended well.
    """

    def __init__(self, record: str | os.PathLike):
        self._record = Path(record)
        self._copies = self._record.with_suffix("")

    def __enter__(self) -> "Stages":
        self._copies.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, kind, error, traceback) -> None:
        if error is None:
            shutil.rmtree(self._copies)

    def __call__(
        self, stage: Callable | str, inputs: Mapping[str, object], outputs: Mapping[str, object], settings: Mapping
    ) -> None:
        """Call `stage`, a "module:name" that is imported only then or a function, with all by its arguments' names.

        inputs, outputs: files, folders, or several by name or in order; settings: values whose repr says all, modules
        that are called by name too. Outputs that stay count as new, as the job's.
        """
        said, paths = repr(sorted(settings.items())), list(_paths(outputs))
        # The outputs say which of several calls it is.
        name = stage.partition(":")[2] if isinstance(stage, str) else stage.__name__
        name = " ".join([name, *(os.path.relpath(path, self._record.parent) for path in paths)])
        code = code_hash(source_file(stage) if isinstance(stage, str) else inspect.getfile(stage), *called(said))
        key = hashlib.sha256(repr((code, said, _contents(inputs))).encode()).hexdigest()
        known = json.loads(self._record.read_text("utf-8")) if self._record.is_file() else {}
        made = known.get(name, [])
        if made[:1] == [key] and self._there(paths, outputs, made[1]):
            logging.info("%s: kept", name)
            for path in paths:
                os.utime(path)
            return
        began = time.perf_counter()
        (resolve(stage) if isinstance(stage, str) else stage)(**inputs, **outputs, **settings)
        seconds = round(time.perf_counter() - began, 3)
        logging.info("%s: %.1f s", name, seconds)
        write_json(self._record, known | {name: [key, _contents(outputs), seconds]})
        if self._copies.is_dir():
            for path in paths:
                _copy(path, self._copy(path))

    def _copy(self, path: str) -> Path:
        return self._copies / os.path.relpath(path, self._record.parent).replace("/", "+")

    def _there(self, paths: list[str], outputs: Mapping[str, object], contents: str) -> bool:
        """Whether the outputs are there as they were made, or could be put back from their copies."""
        if all(map(os.path.exists, paths)) and _contents(outputs) == contents:
            return True
        if not all(self._copy(path).exists() for path in paths):
            return False
        for path in paths:
            _copy(self._copy(path), path)
        return _contents(outputs) == contents


def seconds_of(record: str | os.PathLike) -> dict[str, float]:
    """What each stage of a record took, when it was made; of several calls the first."""
    made = json.loads(Path(record).read_text("utf-8"))
    return {name.split()[0]: seconds for name, (*_, seconds) in reversed(made.items())}


def _copy(source: str | os.PathLike, target: str | os.PathLike) -> None:
    """In place of what is there."""
    if Path(source).is_dir():
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(source, target)
    else:
        with replacing(target) as temporary:
            shutil.copyfile(source, temporary)


def _contents(named: Mapping[str, object]) -> str:
    """Hash of files by the names of arguments."""
    digest = hashlib.sha256()
    for name, value in sorted(named.items()):
        for path in map(Path, _paths(value)):
            files = sorted(file for file in path.rglob("[!.]*") if file.is_file()) if path.is_dir() else [path]
            for file in files:
                digest.update(repr((name, file.name, hashlib.sha256(file.read_bytes()).hexdigest())).encode())
    return digest.hexdigest()


def _paths(value) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif value is not None:
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from _paths(each)
