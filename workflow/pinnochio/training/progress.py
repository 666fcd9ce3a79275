"""Lines of the log that say how far a training is, how well it does and how long it will take."""

import logging
import math
import time
from collections.abc import Mapping
from statistics import median

INTERVAL = 15.0  # seconds between two lines


class TrainingProgress:
    """A line at most every INTERVAL seconds: losses, learning rate, speed, time left.

    Losses are medians since the last line, because one field with an inverted element has a residual of any size.
    """

    def __init__(self, phase: str, start: int, steps: int, clock=time.monotonic):
        """`start` of the `steps` are done already; `clock` gives seconds."""
        self.phase, self.start, self.steps, self.clock = phase, start, steps, clock
        self.began = self.last = clock()
        self.seen: dict[str, list[float]] = {}

    def update(self, done: int, losses: Mapping[str, float], rate: float, note: str = "") -> None:
        """Count the losses of a step, after which `done` are done; log a line, ended by `note`, if one is due."""
        for name, value in losses.items():
            self.seen.setdefault(name, []).append(value)
        now = self.clock()
        if now - self.last < INTERVAL and done < self.steps:
            return
        speed = (done - self.start) / max(now - self.began, 1e-9)
        parts = [f"{self.phase}: step {done} of {self.steps}"]
        parts += [f"{name} {median(values):.3g}" for name, values in self.seen.items()]
        parts += [f"learning rate {rate:.2g}", f"{speed:.3g} steps/s", f"{readable((self.steps - done) / speed)} left"]
        logging.info(", ".join(parts + [note] if note else parts))
        self.last, self.seen = now, {}


def readable(seconds: float) -> str:
    """Hours, minutes and seconds.

    >>> readable(3), readable(184), readable(7260)
    ('3 s', '3 min 04 s', '2 h 01 min')
    """
    seconds = math.ceil(seconds)
    if seconds < 60:
        return f"{seconds} s"
    minutes, seconds = divmod(seconds, 60)
    return f"{minutes} min {seconds:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
