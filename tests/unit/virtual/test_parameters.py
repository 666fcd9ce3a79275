"""Distributions of the virtual patients: bounds, moments and what each deformity changes."""

import numpy as np
import pytest

from pinnochio.virtual.parameters import FITTED, TABLE, distribution
from pinnochio.virtual.procedures import DEFORMITIES
from pinnochio.virtual.scanned import sample_patient

GROWN = {"mandible_length", "ramus_height", "gonial_angle"}  # the normal person's, and what the class adds


@pytest.fixture(scope="module")
def cohorts():
    return {d: [sample_patient(np.random.default_rng(seed), d) for seed in range(60)] for d in DEFORMITIES}


def test_every_number_keeps_its_bounds(cohorts):
    for deformity, patients in cohorts.items():
        for name in set(TABLE) - {*FITTED, *GROWN}:
            low, high = distribution(name, False, deformity)[2:]
            signed = deformity == "asymmetry" and name in ("chin_deviation", "occlusal_cant")
            values = np.array([getattr(p, name) for p in patients])
            values = np.abs(values) if signed else values
            assert low <= values.min() < values.max() <= high, (deformity, name)


def test_sample_mean_follows_the_table(cohorts):
    """Untouched numbers have the table's mean, men and women apart, within four standard errors."""
    for name in ("chin_width", "mandible_length", "brow_prominence", "pogonion"):
        for male in (False, True):
            mean, sd = distribution(name, male, "asymmetry")[:2]
            values = [getattr(p, name) for p in cohorts["asymmetry"] if p.male == male]
            assert abs(np.mean(values) - mean) < 4 * sd / np.sqrt(len(values))


def test_deformities_do_what_they_are_called(cohorts):
    get = {d: {n: np.array([getattr(p, n) for p in ps]) for n in TABLE} for d, ps in cohorts.items()}
    assert get["class_ii"]["overjet"].min() >= 5 and get["class_iii"]["overjet"].max() <= -1.5
    assert get["class_ii"]["mandible_length"].mean() + 7 < get["class_iii"]["mandible_length"].mean()
    assert np.abs(get["asymmetry"]["chin_deviation"]).min() >= 4
    assert (get["asymmetry"]["chin_deviation"] * get["asymmetry"]["occlusal_cant"]).max() < 0
    assert 0.3 < (get["asymmetry"]["chin_deviation"] > 0).mean() < 0.7
    assert get["open_bite"]["open_bite"].min() >= 2.5 > get["class_ii"]["open_bite"].max()


def test_unknown_deformity_is_refused():
    with pytest.raises(ValueError, match="unknown deformity 'class_iv'.*class_ii, class_iii"):
        sample_patient(np.random.default_rng(0), "class_iv")
