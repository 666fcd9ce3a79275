"""How much of what a method misses, and could have met, is explained by another one."""

from typing import NamedTuple

import numpy as np

LEVEL = (2.5, 97.5)  # percent


class Share(NamedTuple):
    """A share, 1 for all of it, and the ends of its bootstrap 95% interval; NaN where there is none."""

    share: float
    low: float
    high: float


def explained(errors, baseline, floor, seed: int, draws: int = 10_000) -> Share:
    """(baseline - errors) / (baseline - floor) of the means over the same patients, each (n,) without NaN.

    0 as good as the baseline, 1 at the floor, negative where worse than the baseline. The interval is the percentile
    one over resampled patients. NaN where the baseline's mean is at the floor or below; no interval below two
    patients, or where that happens in a resample.
    """
    values = np.column_stack([errors, baseline, floor]).astype(float)
    n = len(values)
    if n == 0:
        return Share(np.nan, np.nan, np.nan)
    share = float(of_means(values.mean(axis=0)))
    if n < 2 or np.isnan(share):
        return Share(share, np.nan, np.nan)
    counts = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), size=draws)
    shares = of_means((counts @ values / n).T)
    return Share(share, *(float(end) for end in np.percentile(shares, LEVEL)))


def of_means(means):
    """The share of means (3, ...) of errors, baseline and floor; NaN where there is nothing to explain."""
    error, baseline, floor = means
    room = baseline - floor
    return np.where(room > 0, (baseline - error) / np.where(room > 0, room, 1), np.nan)
