"""The point at which a prediction is farthest from all others of its patient."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table, write_csv
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.judged import Judged
from pinnochio.metrics.worst_point import FLAGGED, apart, read_skins, write_skins
from pinnochio.tables.comparison import summarise
from tests.helpers.patients import tiny_patient
from tests.helpers.rows import row
from tests.helpers.tables import make

PLACES = np.random.default_rng(0).uniform(0, 100, (200, 3))
METHODS = ("fem_sliding", "elastic", "pinnochio")


def test_the_nearest_other_prediction_counts_at_every_point():
    """A point that is 8 mm from one and 3 mm from the other is 3 mm apart, wherever all others are near."""
    one, two = PLACES + [8.0, 0, 0], PLACES + [0, 3.0, 0]
    spoiled = two.copy()
    spoiled[7] += [0, 40.0, 0]
    assert apart(PLACES, [one, two]) == pytest.approx(3)
    assert apart(PLACES, [one, spoiled]) == pytest.approx(8)
    assert apart(spoiled, [PLACES, two]) == pytest.approx(40)
    assert np.isnan(apart(PLACES, []))


def test_the_same_samples_are_compared_of_every_method(tmp_path):
    patient = tiny_patient()
    skin = patient.skin_points[np.unique(patient.skin_faces)]
    judged = Judged(skin, np.zeros(len(skin), np.int8), skin, np.zeros(len(skin), np.int8))
    still, before = judged.before(patient).carried(patient.skin_points), judged.before(patient)
    np.testing.assert_allclose(still, skin, atol=1e-6)
    np.testing.assert_allclose(before.carried(patient.skin_points + [1, 2, 3]), still + [1, 2, 3], atol=1e-6)
    write_skins(tmp_path / "skins.h5", {"V01": still, "V02": still + 1})
    read = read_skins(tmp_path / "skins.h5")
    assert list(read) == ["V01", "V02"] and np.abs(read["V02"] - still - 1).max() < 1e-4


def test_a_flag_stands_in_the_table_of_cases_and_beside_the_method(tmp_path):
    """One method has one point 9 mm off in one patient; neither a bound nor a missing skin counts as another method."""
    files = {"metrics": [], "skins": []}
    for method in (*METHODS, "floor_scan", "acmt"):
        rows = [row(f"V{n}", method, 1.0, hdmax=2.0 + n, registration_residual=0.3) for n in (1, 2)]
        write_csv(pd.DataFrame(rows), tmp_path / f"{method}.csv", CASES)
        skins = {f"V{n}": PLACES + 0.1 * len(method) for n in (1, 2)}
        if method == "pinnochio":
            skins["V2"][3] += [0, 0, 9.0]
        if method == "floor_scan":
            skins["V2"] = 1.0 * PLACES + 20
        write_skins(tmp_path / f"{method}.h5", {} if method == "acmt" else skins)
        files["metrics"].append(tmp_path / f"{method}.csv")
        files["skins"].append(tmp_path / f"{method}.h5")
    make(tmp_path / "cases.csv", "pinnochio.tables.cases", cohort="c", bounds=["floor_scan"], **files)
    cases = read_table(tmp_path / "cases.csv", CASES)
    apart_of = cases.set_index(["case", "method"])["apart"]
    assert apart_of["V2", "pinnochio"] > 8.5 > FLAGGED > apart_of["V1", "pinnochio"]
    assert apart_of.drop(["pinnochio", "floor_scan", "acmt"], level=1).max() < 1
    assert apart_of["V2", "floor_scan"] > 30 and np.isnan(apart_of["V1", "acmt"])
    frame = summarise(cases, None, [*METHODS, "acmt"], 1, ["floor_scan"]).set_index("method")
    assert frame.loc["pinnochio", "flagged"] == 1 and frame.loc["elastic", "flagged"] == 0
    assert np.isnan(frame.loc["floor_scan", "flagged"])
    assert (frame["hdmax_mean"] == 3.5).all() and (frame["hdmax_worst"] == 4).all()
    arguments = {"methods": [*METHODS, "acmt"], "bounds": ["floor_scan"], "reference": None, "published": False}
    arguments |= {"cases": tmp_path / "cases.csv", "cohort": "c", "seed": 1}
    make(tmp_path / "accuracy.csv", "pinnochio.tables.accuracy", **arguments)
    lines = (tmp_path / "accuracy.md").read_text().splitlines()
    assert [line.split("|")[1].strip() for line in lines if "4.0000 ! 1" in line] == ["PINNOCHIO"]
