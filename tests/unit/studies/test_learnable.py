"""Shares that can be learned: all of a linear rule, none of noise, each patient left out of its own regression."""

import numpy as np
import pandas as pd
import pytest

from studies.cohort_checks.learnable import CASE, FACE, KNOWN, REGIONS, expected, summarise


def cohort(mean_of, count=40, inside=0.0):
    """Rows of patients with random inputs; inside: variance of the deviation within a quarter."""
    draws, rows = np.random.default_rng(0), []
    for case in range(count):
        known = dict(zip(KNOWN, draws.normal(size=len(KNOWN)), strict=True))
        for region in REGIONS:
            for part in range(4):
                mean = mean_of(known, draws)
                place = {"case": f"V{case:02d}", "region": region, "part": part, "area": 100.0 + 50 * part}
                rows.append(place | {"mean": mean, "square": mean**2 + inside} | known)
    return summarise(pd.DataFrame(rows)[[column.name for column in CASE]]).set_index("region")


def test_a_linear_rule_is_learned_and_its_mean_alone_is_not():
    table = cohort(lambda known, draws: 2 * known["advance"] - known["mass"])
    assert table["linear"].to_numpy() == pytest.approx(100) and (table["systematic"].abs() < 10).all()
    assert table["left"].to_numpy() == pytest.approx(0, abs=1e-6) and len(table) == len(REGIONS) + 1


def test_a_constant_is_learned_by_the_mean_and_what_lies_inside_a_quarter_is_left():
    table = cohort(lambda known, draws: 1.0, inside=1.0)
    assert table.loc[FACE, ["systematic", "linear"]].to_numpy(float) == pytest.approx([50, 50])
    assert table.loc[FACE, "rms"] == pytest.approx(np.sqrt(2)) and table.loc[FACE, "left"] == pytest.approx(1)


def test_noise_is_not_learned():
    table = cohort(lambda known, draws: draws.normal())
    assert table.loc[FACE, "linear"] < 0  # an honest regression loses on noise


def test_no_patient_is_in_the_regression_that_predicts_it():
    inputs, means = np.zeros((6, 2)), np.array([0, 0, 0, 0, 0, 6.0])
    flat, fitted = expected(inputs, means)
    assert flat == pytest.approx([1.2] * 5 + [0]) and fitted == pytest.approx(flat)
