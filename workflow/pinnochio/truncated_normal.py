"""Draws of a truncated normal, to the bits of scipy.stats.truncnorm, whose import takes half a second."""

import numpy as np
from scipy.special import log1p, log_ndtr, logsumexp, ndtr, ndtri_exp


def quantile(share: float | np.ndarray, low: float, high: float) -> np.ndarray:
    """Quantile of the standard normal truncated to [low, high], low < 0 < high; share in (0, 1), of any shape."""
    if not low < 0 < high:
        raise ValueError(f"[{low}, {high}] does not hold the mean")
    inside = log1p(-ndtr(low) - ndtr(-high))
    return ndtri_exp(logsumexp([np.full_like(share, log_ndtr(low)), np.log(share) + inside], axis=0))


def truncated(rng: np.random.Generator, mean: float, sd: float, low: float, high: float) -> float:
    """One value of the normal (mean, sd) truncated to [low, high], low < mean < high; exactly one draw of `rng`."""
    return float(quantile(rng.random(), (low - mean) / sd, (high - mean) / sd) * sd + mean)
