"""The explained share: hand-worked numbers, and an interval that shrinks with the patients."""

import numpy as np
import pytest

from pinnochio.statistics.shares import explained


def test_the_baseline_explains_nothing_and_the_floor_all():
    rng = np.random.default_rng(0)
    baseline, floor = 1.2 + 0.2 * rng.random(20), 0.2 + 0.1 * rng.random(20)
    assert explained(baseline, baseline, floor, 1) == (0, 0, 0)
    assert explained(floor, baseline, floor, 1) == (1, 1, 1)


def test_it_is_of_means_and_may_be_negative():
    """Means 1.0, 1.4 and 0.4: 0.4 of 1.0; not the mean of shares of patients."""
    share, low, high = explained([0.8, 1.2], [1.0, 1.8], [0.2, 0.6], 1)
    assert share == pytest.approx(0.4) and low <= share <= high
    assert explained([1.6, 2.0], [1.0, 1.8], [0.2, 0.6], 1).share == pytest.approx(-0.4)


def test_the_interval_is_seeded_and_that_of_the_delta_method():
    rng = np.random.default_rng(2)
    errors, baseline, floor = (mean + 0.1 * rng.normal(size=400) for mean in (1.0, 1.3, 0.3))
    share, low, high = explained(errors, baseline, floor, 5)
    assert (share, low, high) == explained(errors, baseline, floor, 5) != explained(errors, baseline, floor, 6)
    room = baseline.mean() - floor.mean()
    deviation = ((baseline - errors) - share * (baseline - floor)).std() / room / np.sqrt(400)
    assert (low, high) == pytest.approx((share - 1.96 * deviation, share + 1.96 * deviation), abs=0.15 * deviation)


def test_where_nothing_is_left_to_explain_there_is_no_share():
    assert np.isnan(explained([1.0, 2.0], [0.5, 0.5], [0.5, 0.6], 1)).all()
    assert np.isnan(explained([], [], [], 1)).all()
    share, low, high = explained([1.0], [1.5], [0.5], 1)
    assert share == 0.5 and np.isnan(low) and np.isnan(high)
    assert np.isnan(explained([1.0, 1.0], [2.0, 0.5], [0.5, 0.6], 1)[1:]).all()  # some resamples have no room
