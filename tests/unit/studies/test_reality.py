"""The scale of a reality is where the mean distance is the one aimed at; values there are interpolated."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.metrics.region_errors import REGIONS
from pinnochio.virtual.ground_truth import NOMINAL, REALITIES
from studies.cohort_checks.reality import CASE, SCALES, at_scale, scale_for, summarise


@pytest.fixture
def rows():
    """Two patients of 0.4 and 0.6 mm whose distance grows by 0.8 and 1.0 mm per scale."""
    made = []
    for case, start, slope in (("V01", 0.4, 0.8), ("V02", 0.6, 1.0)):
        for reality in (*REALITIES, NOMINAL):
            for scale in SCALES if reality != NOMINAL else (0.0,):
                errors = {"cd": start + slope * scale, "pwr2": 100 - 10 * scale, "p90": 2 * (start + slope * scale)}
                made.append({"case": case, "reality": reality, "scale": scale} | errors | dict.fromkeys(REGIONS, scale))
    return pd.DataFrame(made)[[column.name for column in CASE]]


def test_the_scale_gives_the_mean_distance(rows):
    clinic = rows[rows["reality"] == "clinic"]
    assert scale_for(clinic, 1.30) == pytest.approx((1.30 - 0.5) / 0.9)
    assert scale_for(clinic, 9.0) == SCALES[-1]  # out of reach
    patients = at_scale(clinic, 0.7)
    assert patients["cd"].to_list() == pytest.approx([0.4 + 0.56, 0.6 + 0.7])
    assert patients["cheeks"].to_list() == pytest.approx([0.7, 0.7])


def test_the_table_says_what_ours_has_and_what_is_aimed_at(rows):
    table = summarise(rows).set_index(["reality", "what"])
    for reality, expected in REALITIES.items():
        assert table.loc[(reality, "ours"), "cd"] == pytest.approx(expected.target)
        assert table.loc[(reality, "aim"), "cd"] == expected.target and np.isnan(table.loc[(reality, "aim"), "scale"])
    assert table.loc[(NOMINAL, "ours"), "cd"] == pytest.approx(0.5)
