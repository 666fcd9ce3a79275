"""Draws of a truncated normal are those of SciPy's statistics, to the bit."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from pinnochio.truncated_normal import quantile, truncated


def test_quantiles_are_those_of_scipy_to_the_bit():
    rng = np.random.default_rng(0)
    shares = rng.random(1000)
    for low, high in [
        (-2.5, 2.5),
        (-0.01, 0.02),
        (-9.0, 0.3),
        (-0.3, 40.0),
        *zip(-rng.random(50), rng.random(50), strict=True),
    ]:
        assert (quantile(shares, low, high) == truncnorm.ppf(shares, low, high)).all()
        assert quantile(shares[0], low, high) == truncnorm.ppf(shares[0], low, high)


def test_one_value_takes_one_draw_and_stays_within():
    rng, again = np.random.default_rng(1), np.random.default_rng(1)
    drawn = [truncated(rng, 3.0, 2.0, -1.0, 4.0) for _ in range(200)]
    assert drawn == [truncnorm.ppf(again.random(), -2.0, 0.5, loc=3.0, scale=2.0) for _ in range(200)]
    assert min(drawn) > -1 and max(drawn) < 4


def test_limits_hold_the_mean():
    with pytest.raises(ValueError, match="does not hold the mean"):
        truncated(np.random.default_rng(0), 5.0, 1.0, 0.0, 4.0)
