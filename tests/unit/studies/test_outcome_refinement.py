"""The table of the outcome's discretisation error."""

import pandas as pd

from studies.cohort_checks import refinement


def test_the_outcomes_error_is_a_share_of_the_methods():
    row = {"case": "a", "reference": 90000, "p95": 0.3, "seconds": 1.0}
    rows = pd.DataFrame(
        [row | {"mesh": "methods", "nodes": 5000, "mean": 0.2}, row | {"mesh": "outcome", "nodes": 30000, "mean": 0.05}]
    )
    assert refinement.summarise(rows)["share"].tolist() == [100, 25]
