"""Paired comparisons over patients: Wilcoxon test and bootstrap interval by SciPy, Holm correction."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from pinnochio.statistics.attainable import SMALLEST_N

# Up to so many pairs ties are tested over all 2^n signs, beyond by the normal approximation, as in SciPy's "auto".
ALL_SIGNS_N = 13


@dataclass(frozen=True)
class Comparison:
    """n pairs; median and mean difference (method minus reference); p is NaN where no test was made.

    `statement` says how p came about, or why there is none; low, high: 95% interval of the mean difference.
    """

    n: float
    median: float
    mean: float
    low: float
    high: float
    p: float
    statement: str

    @classmethod
    def none(cls, statement: str, n: float = np.nan) -> "Comparison":
        """No comparison, and why."""
        return cls(n, *[np.nan] * 5, statement)


def compare(values, reference, seed: int, draws: int = 10_000) -> Comparison:
    """Compare two methods over the same patients; values and reference (n,), without NaN."""
    difference = np.asarray(values, float) - np.asarray(reference, float)
    n = len(difference)
    if n == 0:
        return Comparison.none("no common patient: not tested", 0)
    p, statement = wilcoxon(difference)
    low, high = bootstrap_interval(difference, seed, draws)
    return Comparison(n, float(np.median(difference)), float(difference.mean()), low, high, p, statement)


def wilcoxon(difference) -> tuple[float, str]:
    """Two-sided p of the signed-rank test and how it was made.

    Zero differences are dropped (Wilcoxon's own way) and ties share their mean rank. Without ties the null
    distribution is exact; with ties it is counted over all signs of few pairs, else approximated by the normal one,
    with its correction for ties and, so that it does not overstate, for continuity.
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
    if len(np.unique(np.abs(signed))) == len(signed):
        method, statement = "exact", "exact"
    elif len(signed) <= ALL_SIGNS_N:
        method, statement = stats.PermutationMethod(n_resamples=2**ALL_SIGNS_N), "exact; ties share ranks"
    else:
        method, statement = "asymptotic", "normal approximation: ties"
    result = stats.wilcoxon(signed, method=method, correction=True)
    dropped = f"; {zeros} zero difference{'s' * (zeros > 1)} dropped" if zeros else ""
    return float(result.pvalue), statement + dropped


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
    interval = stats.bootstrap(
        (difference,), np.mean, n_resamples=draws, method="percentile", rng=np.random.default_rng(seed)
    ).confidence_interval
    return float(interval.low), float(interval.high)
