"""Whether a training has converged, by a stated rule on its loss history."""

import os
from dataclasses import dataclass

import numpy as np

from pinnochio.columns import read_csv
from pinnochio.training.loop import COLUMNS

PARTS = 20  # of the steps: the medians of the training's own data term stand for a curve where nobody is held back


@dataclass(frozen=True)
class Convergence:
    """Where a training ended.

    done: steps; held_back: whether the curve is the error of patients held back, else of those trained on; fall: share
    by which the least error fell over the last part of the steps, nan where the curve has no point there or before.
    """

    done: int
    held_back: bool
    fall: float

    def flat(self, limit: float) -> bool:
        """Whether it fell by no more than that share."""
        return bool(self.fall <= limit)


def convergence(history: str | os.PathLike, part: float) -> Convergence:
    """Of a loss history as the training writes it; part: share of the steps done, at the end, that the fall is of.

    A learning rate that is brought to zero flattens every curve: flat says that this training has ended, not that a
    longer one would not have gone further.
    """
    rows = read_csv(history, usecols=COLUMNS, dtype=float)[[*COLUMNS]].to_numpy()
    if not len(rows):  # stopped before its first step
        return Convergence(0, False, np.nan)
    steps, data, looks = (rows[:, COLUMNS.index(name)] for name in ("step", "data", "validation"))
    done = int(steps[-1]) + int(np.isfinite(rows[-1, COLUMNS.index("learning_rate")]))
    held_back = bool(np.isfinite(looks).any())
    if held_back:
        seen = np.isfinite(looks)
        at, errors = steps[seen], looks[seen]
    else:
        pieces = [piece for piece in np.array_split(np.arange(len(steps)), PARTS) if len(piece)]
        at = np.array([steps[piece[-1]] + 1 for piece in pieces])
        errors = np.array([np.nanmedian(data[piece]) for piece in pieces])
    before = errors[at <= (1 - part) * done]
    late = errors[at > (1 - part) * done]
    if not len(before) or not len(late):
        return Convergence(done, held_back, np.nan)
    least = before.min()
    return Convergence(done, held_back, float(1 - min(least, late.min()) / least))
