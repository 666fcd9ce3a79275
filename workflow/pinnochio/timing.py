"""How long a prediction takes: what belongs to the patient, and one plan."""

import math
import statistics
import time
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")
REPEATS, PATIENCE = 3, 0.02  # of a timed prediction that takes less than so many seconds; a longer one is made once


def timed(prepare: Callable[[], Callable[[], Result]], warm: bool = True) -> tuple[Result, float, float]:
    """prepare()(), seconds of a warm call (median of REPEATS where it is quick), of preparing with the first call.

    warm: False for a single call, whose seconds hold what only a first one takes.
    """
    start = time.perf_counter()
    predict = prepare()
    if warm:
        predict()
    setup = time.perf_counter() - start
    return *repeated(predict, PATIENCE if warm else 0.0), setup


def repeated(predict: Callable[[], Result], patience: float = math.inf) -> tuple[Result, float]:
    """predict(), median seconds of REPEATS calls; of a single one that takes longer than `patience` seconds."""
    seconds = []
    while not seconds or (len(seconds) < REPEATS and seconds[0] < patience):
        start = time.perf_counter()
        result = predict()
        seconds.append(time.perf_counter() - start)
    return result, statistics.median(seconds)
