"""A second process, which works beside this one."""

from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context


@cache
def beside() -> ProcessPoolExecutor:
    """A process that makes one thing after another: a fork of this one as it is when the first is submitted."""
    return ProcessPoolExecutor(1, get_context("fork"))
