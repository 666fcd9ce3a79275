"""The table of the inverse on numbers made by hand."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table, write_csv
from studies.inverse.columns import RECOVERED
from studies.inverse.table import INVERSES
from tests.helpers.tables import make

CASES = [f"V{number:02d}" for number in range(24)]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two dozen patients: a maxilla off by up to 0.15 mm, a chin by ten times as much."""
    folder, rng, files = tmp_path_factory.mktemp("inverse"), np.random.default_rng(0), []
    for case in CASES:
        rows = [
            {"case": case, "task": task, "tolerance": tolerance, "segment": segment, "moved": 4.0, "error": error}
            | {"degrees": error / 2, "misfit": tolerance, "seconds": 2.0, "code": "code"}
            for task, tolerance in (("simulated", 0.002), ("simulated", 0.1), ("outcome", 0.1))
            for segment, error in zip(("lefort1", "chin"), rng.uniform(0.1, 0.15) * np.array([1, 10]), strict=True)
        ]
        files.append(folder / f"{case}.csv")
        write_csv(pd.DataFrame(rows), files[-1], RECOVERED)
    table = folder / "inverse.csv"
    make(table, "studies.inverse.table", recovered=files, cohort="virtual cohort", seed=1)
    return read_table(table, INVERSES).set_index(["task", "tolerance", "bone"]), table.with_suffix(".md").read_text()


def test_each_task_has_a_row_by_tolerance_and_bone(made):
    frame, text = made
    assert len(frame) == 3 * 3 and list(frame.index[0]) == ["simulated", 0.002, "all"]
    row = frame.loc[("outcome", 0.1, "maxilla")]
    assert (row["patients"], row["bones"]) == (24, 24) and frame.loc[("outcome", 0.1, "all"), "bones"] == 48
    assert 0.1 <= row["error_low"] <= row["error"] <= row["error_high"] <= row["error_worst"] <= 0.15
    assert row["degrees"] == pytest.approx(row["error"] / 2, abs=1e-4)
    assert frame.loc[("outcome", 0.1, "chin"), "error"] == pytest.approx(10 * row["error"], rel=1e-3)
    assert text.count("| outcome |") == 3
