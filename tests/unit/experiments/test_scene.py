"""Scenes: parts of a plan, and what the table of the trials says."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.plans.scenarios import parts
from pinnochio.tables.reductions import TRIALS, summarise


def test_parts_of_a_plan_compose_to_it():
    jaw = RigidMotion.from_degrees([3, 1, -2], [1, -6, 2], [0, -60, -60])
    centre = np.array([0.0, -90, -80])
    advance = RigidMotion(translation=np.array([0.0, -4, 0]))
    whole = advance.apply(jaw.apply(centre[None]))[0] - centre
    chin = RigidMotion(advance.rotation @ jaw.rotation, whole, centre)
    upper = RigidMotion(translation=np.array([0.0, -3, 0]))
    plan = Plan("-", {"lefort1": upper, "mandible_distal": jaw, "chin": chin})
    by_name = parts(plan, centre)
    assert list(by_name) == ["lefort1", "mandible", "genioplasty", "bimaxillary"]
    assert set(by_name["mandible"].motions) == {"mandible_distal", "chin"} and by_name["bimaxillary"] == plan
    points = np.random.default_rng(1).normal(centre, 10, (5, 3))
    own = by_name["genioplasty"].motions["chin"]
    np.testing.assert_allclose(own.apply(jaw.apply(points)), chin.apply(points), atol=1e-9)
    same = Plan("-", {"mandible_distal": jaw, "chin": jaw})
    np.testing.assert_array_equal(parts(same, centre)["genioplasty"].motions["chin"].translation, [0, -5, 0])
    assert list(parts(Plan("-", {"lefort1": upper}))) == ["lefort1"]


def test_summary_compares_with_the_whole_patient_and_says_what_pays():
    row = {column.name: 1 if column.kind in (int, float) else "x" for column in TRIALS} | {"converged": True}
    full = row | {"model": "full", "error_mean": 0, "error_max": 0, "first_seconds": 3, "further_seconds": 2}
    auto = row | {"model": "auto", "share": 0.4, "error_mean": 0.1, "error_max": 0.4}
    other = auto | {"case": "B", "error_mean": 0.3, "error_max": 0.2, "converged": False}
    slow = {"plan": "y", "further_seconds": 3}
    rows = [full, auto, full | {"case": "B"}, other, full | slow | {"further_seconds": 2}, auto | slow]
    summary = summarise(pd.DataFrame([*rows, full | {"plan": "z"}, auto | {"plan": "z", "share": 1.0}]))
    assert summary["n"].tolist() == [2, 1, 1] and summary["failed"].tolist() == [1, 0, 0]
    assert summary["reduced"].tolist() == [2, 1, 0]
    assert summary.loc[0, ["error_mean", "error_mean_max", "error_max"]].tolist() == pytest.approx([0.2, 0.3, 0.4])
    ratios = summary.loc[0, ["further_ratio", "first_ratio", "whole_ratio"]].tolist()
    assert ratios == pytest.approx([2, 3, 4 / 2])
    assert summary["pays"].tolist() == ["one plan, many plans", "one plan", "not made"]
