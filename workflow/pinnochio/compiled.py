"""Loops that Numba compiles."""

import inspect
from functools import partial

from numba import njit

from pinnochio.code import code_hash


def compiled(function=None, **options):
    """Compile the function as numba.njit does, without the interpreter's lock, and keep the machine code on disk.

    Numba notices an edit of the function's own file alone; here the kept code is also dropped after an edit of any
    module of the project that this file imports, or where it names a class that is no longer there, and kept where a
    file is merely copied.
    """
    if function is None:
        return lambda function: compiled(function, **options)
    dispatcher = njit(cache=True, nogil=True, **options)(function)
    kept = dispatcher._cache._cache_file
    kept._source_stamp = code_hash(inspect.getfile(function))
    kept._load_index = partial(_readable, kept._load_index)
    return dispatcher


def _readable(load) -> dict:
    """The index of kept code; empty where it cannot be read, which Numba finds out before it compares stamps."""
    try:
        return load()
    except (AttributeError, ImportError):
        return {}
