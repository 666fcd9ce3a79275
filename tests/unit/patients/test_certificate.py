"""What the certificate measures of known fields, and what it says of them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pinnochio.model.patient import FREE
from pinnochio.model.regions import CHIN, NAMES, NOSE
from pinnochio.patients.certificate import in_distribution, in_words, interval_measures, measures, plain
from pinnochio.patients.in_distribution import Norm, Ranges, anatomy_quantities, plan_quantities
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration, Interval
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings

FEM = fem_settings()
PATIENT = tiny_patient()
QUALITY = {
    "volume_cm3": {"superficial": 5.0, "muscle": 3.0, "cranium": 2.0, "lefort1": 1.0},
    "thickness_mm": {"cranium": None, "lefort1": {"mean": 8.0}},
    "contact_cm2": {"cranium": {"fixed": 1.0}, "lefort1": {"moving": 2.0}},
}


def certificate(displacement, plan, **parts):
    said = {
        "measures": measures(PATIENT, plan, displacement, FEM),
        "models": None,
        "interval": None,
        "in_distribution": None,
    }
    return json.loads(json.dumps(plain(said | parts), allow_nan=False))


def judgements(said):
    return {row.what: row.good for row in in_words(said)}


def test_rest_is_valid_in_equilibrium_and_where_a_plan_of_nothing_wants_it():
    said = certificate(np.zeros_like(PATIENT.points), Plan("tiny", {}))
    of = said["measures"]
    assert (of["inverted"], of["eqres_rel"], of["moving_error"], of["skin_max_mm"]) == (0, 0, 0, 0)
    assert of["min_jacobian"] == pytest.approx(1) and of["elements"] == len(PATIENT.cells)
    assert judgements(said)["Elements turned inside out"] and judgements(said)["Smallest volume ratio (min J)"]


def test_a_field_that_ignores_the_plan_is_off_by_the_plan():
    plan = tiny_plan(0, -3, 0, pitch=0)
    said = certificate(np.zeros_like(PATIENT.points), plan)
    assert said["measures"]["moving_error"] == pytest.approx(3)
    assert "3.000 mm" in [row.value for row in in_words(said)]
    moved = certificate(np.tile([0.0, -3, 0], (len(PATIENT.points), 1)), plan)["measures"]
    assert moved["moving_error"] == pytest.approx(0, abs=1e-9)
    assert (moved["skin_mean_mm"], moved["skin_max_mm"]) == pytest.approx((3, 3))


def test_an_element_turned_inside_out_is_found():
    field = np.zeros_like(PATIENT.points)
    cell = PATIENT.cells[(PATIENT.node_type[PATIENT.cells] == FREE).any(axis=1)][0]
    node = cell[PATIENT.node_type[cell] == FREE][0]
    field[node] = 2 * (PATIENT.points[cell[cell != node]].mean(axis=0) - PATIENT.points[node])
    said = certificate(field, Plan("tiny", {}))
    assert said["measures"]["inverted"] >= 1 and said["measures"]["min_jacobian"] < 0
    good = judgements(said)
    assert good["Elements turned inside out"] is False and good["Smallest volume ratio (min J)"] is False
    assert good["Residual"] is None


def test_the_interval_counts_where_it_is_widened():
    calibration = Calibration("m", 0.9, 12, 5, {name: 1.0 for name in NAMES} | {"nose": None}, {})
    region = np.array([CHIN] * 3 + [NOSE, -1], np.int8)
    interval = Interval(np.zeros((1, 3)), np.zeros(1), np.array([1.0, 1.05, 2.5, np.nan, np.nan]), region)
    said = interval_measures(interval, calibration)
    assert (said["median_mm"], said["largest_mm"], said["patients"]) == (1.05, 2.5, 12)
    assert said["widened_percent"] == pytest.approx(100 / 3)


@pytest.mark.parametrize(("factor", "within"), [(1.0, True), (6.0, False)])
def test_a_plan_far_beyond_the_training_is_called_so(factor, within):
    patient = replace(PATIENT, segments=("lefort1",))

    def forward(distance):
        return Plan("tiny", {"lefort1": tiny_plan(0, -distance, 0, pitch=1).motion("left")})

    plans = [forward(distance) for distance in (2, 3, 4, 5)]
    anatomy = Norm.of([anatomy_quantities(patient, QUALITY)] * 4)
    movements = Norm.of([plan_quantities(patient, plan) for plan in plans], True)
    ranges = Ranges(anatomy, movements, ["labelled"], ["chin", "lefort1"])
    compared = in_distribution(patient, forward(4 * factor), QUALITY, ranges)
    assert compared["within"] == compared["plan"]["within"] == within
    assert compared["anatomy"]["within"] and compared["muscle"]["within"]
    models = {"cohort": "virtual cohort", "usual": {"min_jacobian": [0.1, 0.2, 0.3]}}
    interval = {"level": 0.9, "patients": 4, "median_mm": 1.0, "largest_mm": 2.0, "widened_percent": 0.0}
    said = certificate(
        np.zeros_like(PATIENT.points), tiny_plan(0, -2), models=models, interval=interval, in_distribution=compared
    )  # fmt: skip
    assert judgements(said)["Plan"] is within and judgements(said)["Bone segments"]
    words = {row.what: row.meaning for row in in_words(said)}
    assert ("do not rely on it" in words["Interval"]) != within and "0.10 to 0.30, median 0.20" in str(words)
    assert ("_mm is 2" in words["Plan"]) != within
    beyond = in_distribution(patient, plans[0], QUALITY, replace(ranges, segments=["chin"]))
    assert not beyond["within"] and not beyond["segments"]["within"]
