"""The tables of the nasolabial angle and of the outcome's discretisation error."""

import pandas as pd

from pinnochio.virtual import nasolabial
from studies.cohort_checks import refinement


def test_our_angle_stands_beside_the_published_ones():
    rows = pd.DataFrame({"case": ["a", "b"], "before": [110.0, 120], "after": [104.0, 118]})
    table = nasolabial.summarise(rows).set_index("what")
    assert table.loc["virtual cohort, after", "mean"] == 111 and table.loc["virtual cohort, change", "mean"] == -4
    assert table.loc["Dolphin, after", ["mean", "sd"]].tolist() == [119.9, 8.6]


def test_the_outcomes_error_is_a_share_of_the_methods():
    row = {"case": "a", "reference": 90000, "p95": 0.3, "seconds": 1.0}
    rows = pd.DataFrame(
        [row | {"mesh": "methods", "nodes": 5000, "mean": 0.2}, row | {"mesh": "outcome", "nodes": 30000, "mean": 0.05}]
    )
    assert refinement.summarise(rows)["share"].tolist() == [100, 25]
