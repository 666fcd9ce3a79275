"""What the certificate measures of known fields, and what it says of them."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from pinnochio.methods.elastic import linear_field
from pinnochio.model.patient import FREE, LOWER_LIP, UPPER_LIP
from pinnochio.model.regions import CHIN, NAMES, NOSE
from pinnochio.patients.certificate import (
    ADVICE,
    CARE,
    NOT_USABLE,
    USABLE,
    _field_rows,
    in_distribution,
    in_words,
    interval_measures,
    measures,
    plain,
    verdict,
)
from pinnochio.patients.in_distribution import Norm, Ranges, anatomy_quantities, out_of_range, plan_quantities, widening
from pinnochio.patients.result import Solution
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration, Interval
from scripts.patients.certify import from_elasticity
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
        "solution": asdict(Solution()),
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


def test_bones_unlike_peoples_ask_for_care_and_guessed_cuts_are_named():
    imported = {"warnings": [], "care": [], "guessed": ["lefort1"]}
    said = {"import": imported} | certificate(np.zeros_like(PATIENT.points), Plan("tiny", {}))
    grade = verdict(said).grade
    assert judgements(said)["Cuts by rule"] is None
    imported["care"] = ["mandible: 20 cm3, usual are 30 to 130"]
    assert not judgements(said)["Bones unlike people's"] and verdict(said).grade in (CARE, grade) != (USABLE, USABLE)
    assert "mandible: 20 cm3" in " ".join(verdict(said).reasons)


def test_lips_that_cross_are_measured():
    layer = np.rint((PATIENT.points[:, 2] - 40) / 5)
    lip = np.select([layer == 1, layer == 2], [LOWER_LIP, UPPER_LIP]).astype(np.int8)
    field = np.where((layer <= 1)[:, None], [0, 0, 8.0], 0.0)  # 3 mm through the upper lip
    said = [measures(replace(PATIENT, lip=lip), Plan("tiny", {}), way, FEM)["lips_cross_mm"] for way in (field, -field)]
    assert 2 < said[0] < 4.5 and said[1] == 0


def test_a_field_that_ignores_the_plan_is_off_by_the_plan():
    plan = tiny_plan(0, -3, 0, pitch=0)
    said = certificate(np.zeros_like(PATIENT.points), plan)
    assert said["measures"]["moving_error"] == pytest.approx(3)
    assert "3.000 mm" in [row.value for row in in_words(said)]
    assert (said["measures"]["motion_mm"], said["measures"]["turn_degrees"]) == pytest.approx((3, 0))
    moved = certificate(np.tile([0.0, -3, 0], (len(PATIENT.points), 1)), plan)["measures"]
    assert moved["moving_error"] == pytest.approx(0, abs=1e-9)
    assert (moved["skin_mean_mm"], moved["skin_max_mm"]) == pytest.approx((3, 3))


def test_a_point_far_from_linear_elasticity_is_to_be_looked_at():
    plan = tiny_plan(0, -3, 0, pitch=0)
    near = linear_field(PATIENT, plan, FEM)[0]
    far = near.copy()
    point = PATIENT.skin_nodes[PATIENT.judged_points[0]]
    far[point] += [0, -7.0, 0]
    assert from_elasticity(PATIENT, plan, near, FEM) < 1e-6
    assert from_elasticity(PATIENT, plan, far, FEM) == pytest.approx(7, rel=1e-3)
    for field, good in ((near, True), (far, False)):
        said = certificate(field, plan)
        assert "Farthest from linear elasticity" not in judgements(said)
        said["measures"]["apart_mm"] = from_elasticity(PATIENT, plan, field, FEM)
        assert judgements(said)["Farthest from linear elasticity"] is good


def test_an_element_turned_inside_out_is_counted():
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


@pytest.mark.parametrize(("factor", "within", "far"), [(1.0, True, False), (1.6, False, False), (6.0, False, True)])
def test_a_plan_beyond_the_training_is_called_so(factor, within, far):
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
    interval["widening"] = widening(compared)
    said = certificate(
        np.zeros_like(PATIENT.points), tiny_plan(0, -2), models=models, interval=interval, in_distribution=compared
    )  # fmt: skip
    assert judgements(said)["Plan"] is within and judgements(said)["Bone segments"]
    words = {row.what: row.meaning for row in in_words(said)}
    assert ("do not rely on it" in words["Interval"]) == far == out_of_range(compared)
    assert (f"_mm is {4 * factor:.1f}" in words["Plan"]) != within and "0.10 to 0.30, median 0.20" in str(words)
    assert ("times as wide" in words["Interval"]) != within
    grade, reasons = verdict(said)
    assert grade == NOT_USABLE and any("(Plan: far beyond" in reason for reason in reasons) is far
    beyond = in_distribution(patient, plans[0], QUALITY, replace(ranges, segments=["chin"]))
    assert not beyond["within"] and not beyond["segments"]["within"] and out_of_range(beyond)


USUAL = {"min_jacobian": [0.3, 0.5, 0.9], "eqres_rel": [0.015, 0.05, 0.14], "sliding_error": [0.1, 0.3, 0.6]}


@pytest.mark.parametrize(
    ("measured", "row", "grade"),
    [
        ({}, None, USABLE),
        ({"eqres_rel": 0.2}, "Residual", CARE),
        ({"eqres_rel": 1.66}, "Residual", NOT_USABLE),
        ({"min_jacobian": 0.09}, "Smallest volume ratio (min J)", CARE),
        ({"sliding_error": 1.9}, "Boundary mismatch, sliding", CARE),
        ({"sliding_error": 2.1}, "Boundary mismatch, sliding", NOT_USABLE),
        ({"moving_error": 2.5}, "Boundary mismatch, moving", NOT_USABLE),
        ({"off_bone_mm": 3.1}, "Tissue off its bone", NOT_USABLE),
        ({"motion_mm": 10.1}, "Motion of the bones", CARE),
        ({"turn_degrees": 15.1}, "Motion of the bones", CARE),
        ({"edge_percent": 16.0}, "Edge of the scan", CARE),
        ({"off_mesh_p95_mm": 1.1}, "Detail of the skin", CARE),
        ({"lips_cross_mm": 1.8}, "Lips that cross", CARE),
        ({"lips_left_mm": 2.1}, "Lips apart", CARE),
        ({"lips_left_mm": 9.0, "lips_before_mm": 2.1}, None, USABLE),
        ({"inverted": 1}, "Elements turned inside out", NOT_USABLE),
        ({"min_jacobian": None}, "Smallest volume ratio (min J)", NOT_USABLE),
    ],
)
def test_what_lies_beyond_the_usual_is_marked_and_decides_the_verdict(measured, row, grade):
    said = certificate(np.zeros_like(PATIENT.points), Plan("tiny", {}))
    usual = {"edge_percent": 8.0, "min_jacobian": 0.5, "eqres_rel": 0.1, "moving_error": 0.1, "sliding_error": 0.3}
    said["measures"] |= usual | measured
    rows = _field_rows(said["measures"], {"cohort": "virtual cohort", "usual": USUAL})
    assert [line.what for line in rows if line.good is False or line.bad] == ([row] if row in ADVICE else [])
    assert any(line.bad for line in rows) == (grade == NOT_USABLE)


@pytest.mark.parametrize(
    ("solution", "grade"),
    [
        ({}, USABLE),
        ({"solver": True, "iterations": 9}, USABLE),
        ({"solver": True, "converged": False, "reason": "the line search stagnated", "load": 0.3}, NOT_USABLE),
        ({"solver": True, "load": 0.99}, NOT_USABLE),
        ({"repaired": 1}, USABLE),
        ({"repaired": 10**6}, CARE),
        ({"damping": 0.4}, NOT_USABLE),
        ({"converged": False}, CARE),
    ],
)
def test_how_a_field_came_about_decides_the_verdict(solution, grade):
    said = certificate(np.zeros_like(PATIENT.points), Plan("tiny", {}), solution=asdict(Solution(**solution)))
    assert verdict(said).grade == grade and bool(verdict(said).reasons) == (grade != USABLE)
    assert ("fem_sliding" in str(verdict(said))) == (grade != USABLE and "solver" not in solution)


def test_the_page_says_which_detail_of_the_skin_no_mechanics_computes():
    said = certificate(np.zeros_like(PATIENT.points), Plan("tiny", {}))
    assert said["measures"]["off_mesh_mean_mm"] == 0
    far = {"off_mesh_mean_mm": 0.9, "off_mesh_p95_mm": 2.8, "off_mesh_regions_mm": {"lower_lip": 6.9, "nose": 2.9}}
    said["measures"] |= far
    reason = "For nose and lips take finite elements on a mesh of 20,000 nodes: about 2 s a plan "
    reason += "(Detail of the skin: 2.8 mm off the mesh at 95 % (lower lip 6.9, nose 2.9))"
    assert verdict(said) == (CARE, (reason,))
    (row,) = [line for line in in_words(said) if line.what == "Detail of the skin"]
    assert "0.9 mm in the mean" in row.meaning and "shown, not computed" in row.meaning
