"""A second process, which works beside this one."""

import ctypes
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context


def second_process() -> ProcessPoolExecutor:
    """A process that makes one thing after another, a fork of this one as it is when the first is submitted; it ends
    with this one, also where that is killed."""
    # Of Linux PR_SET_PDEATHSIG.
    ending = partial(ctypes.CDLL(None).prctl, 1, signal.SIGKILL) if sys.platform == "linux" else None
    return ProcessPoolExecutor(1, get_context("fork"), ending)


beside = cache(second_process)  # the same from its first call on
