"""HDF5 files of the study: written with a checksum of the whole file behind it, which reading checks."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager

import h5py

from pinnochio.errors import REMEDY, InputError, damaged
from pinnochio.files import replacing

# HDF5 knows its own end and leaves alone what follows. A file without the mark, one made elsewhere, is read all the
# same: HDF5 itself refuses one that is cut off.
MARK = b"\nsha256:"
SEAL = len(MARK) + hashlib.sha256().digest_size


@contextmanager
def writing(path: str | os.PathLike) -> Iterator[h5py.File]:
    """An open file that replaces `path` when the block ends without an error; the same content gives the same bytes."""
    with replacing(path) as temporary:
        with h5py.File(temporary, "w", track_order=True) as file:
            yield file
        with open(temporary, "r+b") as content:
            digest = hashlib.file_digest(content, "sha256").digest()
            content.seek(0, os.SEEK_END)
            content.write(MARK + digest)


@contextmanager
def reading(path: str | os.PathLike) -> Iterator[h5py.File]:
    """The open file; InputError where it is missing, damaged, or the block finds something else than it looks for."""
    try:
        _check_seal(path)
        with h5py.File(path, "r") as file:
            yield file
    except InputError:
        raise
    except Exception as error:  # HDF5 raises OSError, RuntimeError, KeyError and more
        raise damaged(path, error) from error


def _check_seal(path: str | os.PathLike) -> None:
    with open(path, "rb") as file:
        left = max(0, os.path.getsize(path) - SEAL)
        digest = hashlib.sha256()
        while left and (part := file.read(min(left, 2**20))):
            digest.update(part)
            left -= len(part)
        seal = file.read()
    if seal.startswith(MARK) and seal != MARK + digest.digest():
        raise InputError("-", path, "its content is not what was written: it is damaged", REMEDY)
