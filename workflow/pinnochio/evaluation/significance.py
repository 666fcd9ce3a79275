"""Paired comparisons over patients: exact Wilcoxon test, Holm correction, bootstrap interval."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

# Below six pairs the smallest two-sided p is 2/2^5 = 0.0625: no outcome could be significant.
SMALLEST_N = 6


@dataclass(frozen=True)
class Comparison:
    """n pairs; median and mean difference (method minus reference); p is NaN where no test was made.

    `statement` says how p came about, or why there is none; low, high: 95% interval of the mean difference.
    """

    n: int
    median: float
    mean: float
    low: float
    high: float
    p: float
    statement: str


def compare(values, reference, seed: int, draws: int = 10_000) -> Comparison:
    """Compare two methods over the same patients; values and reference (n,), without NaN."""
    difference = np.asarray(values, float) - np.asarray(reference, float)
    n = len(difference)
    if n == 0:
        return Comparison(0, *[np.nan] * 5, "no common patient: not tested")
    p, statement = wilcoxon(difference)
    low, high = bootstrap_interval(difference, seed, draws)
    return Comparison(n, float(np.median(difference)), float(difference.mean()), low, high, p, statement)


def wilcoxon(difference) -> tuple[float, str]:
    """Two-sided p of the signed-rank test and how it was made.

    Zero differences are dropped (Wilcoxon's own way) and ties share their mean rank; the null distribution is then
    counted exactly, over all signs of these very ranks.
    """
    difference = np.asarray(difference, float)
    # Rounded, so that equal differences of decimal numbers are ties and not the noise of the last bit.
    scale = np.abs(difference).max(initial=0)
    difference = np.round(difference / scale, 12) if scale > 0 else difference
    signed = difference[difference != 0]
    zeros = len(difference) - len(signed)
    if len(difference) < SMALLEST_N:
        return np.nan, f"n = {len(difference)} < {SMALLEST_N}: not tested"
    if len(signed) == 0:
        return np.nan, "all differences are zero: not tested"
    if len(signed) < SMALLEST_N:
        return np.nan, f"only {len(signed)} differences are not zero: not tested"
    ranks = np.rint(2 * rankdata(np.abs(signed))).astype(int)  # doubled, so that mean ranks are whole
    counts = np.ones(1)
    for rank in ranks:
        counts = np.pad(counts, (0, rank)) + np.pad(counts, (rank, 0))
    counts /= counts.sum()
    total = ranks[signed > 0].sum()
    p = min(1.0, 2 * min(counts[: total + 1].sum(), counts[total:].sum()))
    notes = [f"{zeros} zero differences dropped"] if zeros else []
    notes += ["ties share ranks"] if len(np.unique(ranks)) < len(ranks) else []
    return float(p), "; ".join(["exact", *notes])


def holm(p) -> np.ndarray:
    """Holm-adjusted p values; NaN (not tested) stays NaN and does not count as a comparison."""
    p = np.asarray(p, float)
    adjusted = np.full(len(p), np.nan)
    tested = np.flatnonzero(~np.isnan(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    factors = len(order) - np.arange(len(order))
    adjusted[order] = np.minimum(1, np.maximum.accumulate(factors * p[order]))
    return adjusted


def bootstrap_interval(difference, seed: int, draws: int = 10_000) -> tuple[float, float]:
    """95% percentile interval of the mean difference over resampled patients; NaN below two patients."""
    difference = np.asarray(difference, float)
    if len(difference) < 2:
        return np.nan, np.nan
    chosen = np.random.default_rng(seed).integers(len(difference), size=(draws, len(difference)))
    low, high = np.percentile(difference[chosen].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)
