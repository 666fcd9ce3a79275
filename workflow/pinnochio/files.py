"""Writing files so that a half-written one is never taken for a result."""

import errno
import fcntl
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from pinnochio.errors import InputError, StorageError, printable

# Bytes; a disk with less counts as full. On one that is, HDF5 and VTK end the process, SimpleITK and VTK's PLY writer
# leave half a file without a word, and logs cannot say why a stage has failed.
ROOM = 64 * 2**20
LONGEST_NAME = 64
SEAL = b"<!-- sha256 %s -->\n"
# Letters of ASCII: others have two spellings of the same look, which file systems tell apart or not.
NAME = re.compile(rf"(?!-)[A-Za-z0-9_-]{{1,{LONGEST_NAME}}}")


def check_writable(path: str | os.PathLike) -> None:
    """Refuse, by a StorageError, a file or folder where nothing can be written, or less than `ROOM`."""
    path = Path(path)
    try:
        folder = path if path.is_dir() else path.parent
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(2**16))  # free space does not show a quota that is used up
        if shutil.disk_usage(folder).free < ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            remedy = "make room on its disk, then run the same command again; what is finished is kept"
        else:
            remedy = "make its folder writable, or choose another results folder (pathvars)"
        raise StorageError(path, os.strerror(error.errno).lower(), remedy) from error


@contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path beside `path`; move it onto `path` only if the block ends without an error.

    The temporary name keeps the suffix, because most writers choose the format by it. What writers of the same path
    left half-written beside it when they were killed is removed. A disk that is full or read-only before or after the
    block is a StorageError, whatever the writer said of it.
    """
    path = Path(path)
    check_writable(path)
    for rest in path.parent.glob(f".[0-9]*.{path.name}"):
        rest.unlink(missing_ok=True)
    temporary = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        try:
            yield temporary
        finally:
            check_writable(path)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def alone(case: str, folder: str | os.PathLike) -> Iterator[None]:
    """Refuse, by an InputError, a case whose folder another process writes by this at the same time."""
    check_writable(file := Path(folder, ".lock"))
    with open(file, "w") as lock:
        try:
            fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # ends with this process, and is not that of its forks
        except (BlockingIOError, PermissionError) as error:
            raise InputError(case, folder, "another run is at work on it", "wait until it has ended") from error
        yield


def fingerprint(paths: Iterable[str], made: str | os.PathLike) -> str:
    """Hash of the content of files, and of all in folders, by name; hidden ones, and those that are `made` or below a
    pathvar, do not count."""
    total, made = hashlib.sha256(), Path(made).resolve()
    for path in map(Path, paths):
        if str(path).startswith("<") or path.resolve().is_relative_to(made):
            continue
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_file() and not file.name.startswith("."):
                total.update(os.fsencode(file.relative_to(path.parent)))
                total.update(_digest(str(file), file.stat().st_mtime_ns, file.stat().st_size))
    return total.hexdigest()[:16]


@cache
def _digest(file: str, *_state: int) -> bytes:
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").digest()


def seal(path: str | os.PathLike) -> None:
    """Write the SHA-256 of a file of XML behind it, as a comment."""
    with open(path, "r+b") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        file.seek(0, os.SEEK_END)
        file.write(SEAL % digest.encode())


def check_seal(path: str | os.PathLike) -> None:
    """ValueError where a file is not as :func:`seal` left it; one without a seal is none of the study's."""
    content = Path(path).read_bytes()
    body, mark, rest = content.rpartition(SEAL[:12])
    if mark and mark + rest != SEAL % hashlib.sha256(body).hexdigest().encode():
        raise ValueError("its content is not what was written: it is damaged")


def check_name(case: str, name: str, path: str | os.PathLike) -> None:
    """Refuse a name of a patient or plan that a file cannot bear everywhere, or that a command takes for an option."""
    if not NAME.fullmatch(name):
        shown = name if len(name) <= LONGEST_NAME else name[:20] + "..."
        case = case if len(case) <= LONGEST_NAME else shown
        problem = f"the name {shown!r} is not of 1 to {LONGEST_NAME} letters, digits, '-' and '_', the first no '-'"
        raise InputError(case, path, problem, "rename it, such as P01")


def entries(folder: str | os.PathLike) -> list[Path]:
    """What a folder holds, by name, without the files that systems hide in it, as `._plan.json` of macOS; nothing of
    what is no folder."""
    return sorted(Path(folder).glob("[!.]*"))


def check_brought(case: str, path: str | os.PathLike) -> None:
    """Refuse a path that Snakemake takes for a pattern or cannot write down, and what nobody may read."""
    if set("{}<>") & set(str(path)) or printable(str(path)) != str(path):
        remedy = "rename the file or folder that has it"
        raise InputError(case, path, "its path holds a brace, < or >, or a letter that is not UTF-8", remedy)
    for file in [Path(path), *entries(path)]:
        if os.path.exists(file) and not os.access(file, os.R_OK | os.X_OK * file.is_dir()):
            raise InputError(case, file, "its permissions forbid reading it", "make it readable, or copy it elsewhere")
