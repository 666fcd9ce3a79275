"""Writing files so that a half-written one is never taken for a result."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path beside `path`; move it onto `path` only if the block ends without an error.

    The temporary name keeps the suffix, because most writers choose the format by it. What writers of the same path
    left half-written beside it when they were killed is removed.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    for rest in path.parent.glob(f".[0-9]*.{path.name}"):
        rest.unlink(missing_ok=True)
    temporary = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
