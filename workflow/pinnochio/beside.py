"""A second process, which works beside this one."""

import ctypes
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context

PARENT_ENDS = 1  # PR_SET_PDEATHSIG of Linux


def second_process() -> ProcessPoolExecutor:
    """A process that makes one thing after another, a fork of this one as it is when the first is submitted; it ends
    with this one, also where that is killed."""
    ending = partial(ctypes.CDLL(None).prctl, PARENT_ENDS, signal.SIGKILL) if sys.platform == "linux" else None
    return ProcessPoolExecutor(1, get_context("fork"), ending)


beside = cache(second_process)  # the same from its first call on
