"""The dials of a reality are where distance and learnable share are those aimed at; values between are interpolated."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.metrics.region_errors import REGIONS
from pinnochio.virtual.ground_truth import REALITIES, Dials
from studies.cohort_checks.reality import CASE, DECIDED, OPEN, Surface, dials_for, share, summarise


@pytest.fixture
def rows():
    """Two patients, linear in both dials: finite elements miss 0.2 mm more per decided and 0.5 or 0.6 mm per open; a
    perfect learner misses what is open and the floor of 0.2 mm."""
    made = []
    for case, slope in (("V01", 0.5), ("V02", 0.6)):
        for reality in REALITIES:
            for decided in DECIDED:
                for opened in OPEN[reality]:
                    left = 0.2 + slope * opened
                    numbers = {"cd": left + 0.2 * decided, "cd_learner": left, "cd_floor": 0.2, "p90": 2 * left}
                    place = {"case": case, "reality": reality, "decided": decided, "open": opened, "pwr2": 80.0}
                    made.append(place | numbers | dict.fromkeys(REGIONS, decided))
    return pd.DataFrame(made)[[column.name for column in CASE]]


def test_the_dials_give_distance_and_share(rows):
    group = rows[rows["reality"] == "clinic"]
    dials = dials_for(group, 1.30, 37)
    left = 1.30 * np.sqrt(0.63)
    assert dials.open == pytest.approx((left - 0.2) / 0.55, abs=0.01)
    assert dials.decided == pytest.approx((1.30 - left) / 0.2, abs=0.02)
    assert dials_for(group, 9.0, 37).open == OPEN["clinic"][-1]  # out of reach
    at = Surface(group[group["case"] == "V01"])(Dials(0.5, 1.0))
    assert at["cd"] == pytest.approx(0.2 + 0.5 + 0.1) and at["nose"] == pytest.approx(0.5)
    assert share({"cd": 1.0, "cd_learner": 0.8}) == pytest.approx(36)


def test_the_table_says_what_ours_has_and_what_is_aimed_at(rows):
    table = summarise(rows)
    for reality, known in REALITIES.items():
        ours = table[(table["reality"] == reality) & (table["what"] == "ours")]
        assert list(np.round(ours["share"])) == list(known.dials)
        assert ours["cd"].to_numpy() == pytest.approx(known.target, abs=0.01)
        assert ours["floor"].to_numpy() == pytest.approx(0.2)
        (aim,) = table.loc[(table["reality"] == reality) & (table["what"] == "aim"), "cd"]
        assert aim == known.target
