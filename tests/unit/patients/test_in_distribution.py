"""Whether a patient is like those of the training: by hand, by chance, and on the smallest patient."""

import dataclasses
import json

import numpy as np
import pytest

from pinnochio.patients.in_distribution import Norm, Ranges, anatomy_quantities, plan_quantities
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import tiny_patient


def norm(*values, **options):
    return Norm.of([{"a_mm": value} for value in values], **options)


def test_the_threshold_by_hand():
    """Of 0, 10, 40 the ends lie 10 / 30 and 30 / 10 outside the range of the other two."""
    usual = norm(0.0, 10.0, 40.0)
    assert (usual.low["a_mm"], usual.high["a_mm"], usual.patients) == (0, 40, 3)
    assert usual.threshold == pytest.approx(3) and usual.false_alarm == pytest.approx(1 / 4)
    assert usual.compare({"a_mm": 160.0})["within"] and not usual.compare({"a_mm": 161.0})["within"]
    said = usual.compare({"a_mm": -20.0})
    assert said["quantities"]["a_mm"]["excess"] == pytest.approx(0.5) and said["outside"] == ["a_mm"]
    assert usual.compare({"a_mm": 25.0})["outside"] == []


def test_half_a_movement_is_usual_and_the_opposite_one_is_not():
    usual = norm(*np.linspace(8, 10, 9), from_rest=True)
    assert usual.compare({"a_mm": 4.0})["quantities"]["a_mm"]["excess"] == 0
    assert usual.compare({"a_mm": -4.0})["quantities"]["a_mm"]["excess"] == pytest.approx(0.4)


def test_a_range_is_never_narrower_than_what_voxels_can_tell():
    assert norm(5.0, 5.0, 5.0).compare({"a_mm": 5.5})["quantities"]["a_mm"]["excess"] == pytest.approx(0.5)
    assert norm(500.0, 500.0).compare({"a_mm": 510.0})["quantities"]["a_mm"]["excess"] == pytest.approx(0.5)


def test_what_only_one_side_has_cannot_be_compared():
    usual = Norm.of([{"a": 1.0, "b": 2.0}, {"a": 2.0, "b": np.nan}])
    said = usual.compare({"a": 1.5, "c": 3.0})
    assert not said["within"] and said["incomparable"] == ["c"] and said["quantities"]["c"]["low"] is None
    said = usual.compare({"a": np.nan})
    assert not said["within"] and said["incomparable"] == ["a"] and said["quantities"]["a"]["value"] is None


def test_the_false_alarms_are_as_many_as_promised():
    """However many quantities there are, and however skewed."""
    rng, alarms = np.random.default_rng(0), []
    names = [f"q{i}" for i in range(15)]
    for _ in range(60):
        draws = np.exp(rng.normal(size=(70, len(names)))) * 100
        people = [dict(zip(names, row, strict=True)) for row in draws]
        usual = Norm.of(people[:40])
        alarms.append(np.mean([not usual.compare(person)["within"] for person in people[40:]]))
    assert usual.false_alarm == pytest.approx(2 / 41)
    assert 0.025 < np.mean(alarms) < 0.08


def test_ranges_are_read_as_they_were_written(tmp_path):
    ranges = Ranges(norm(0.0, 10.0, 40.0), norm(1.0, 2.0, from_rest=True), ["labelled"])
    ranges.write(tmp_path / "ranges.json")
    assert Ranges.read(tmp_path / "ranges.json") == ranges


def test_quantities_of_a_plan():
    """A turn about the middle of the segment leaves that where it is; the rest is the translation."""
    patient = tiny_patient()
    middle = patient.bone_points[patient.bone_segment == 0].mean(axis=0)
    quantities = plan_quantities(
        patient, Plan("tiny", {"left": RigidMotion.from_degrees([3, 0, 4], [-2, -6, 1], middle)})
    )
    expected = {"sideways_left_mm": 2, "forward_left_mm": 6, "up_left_mm": 1, "rotation_left_deg": 5}
    assert quantities == pytest.approx(expected)
    assert plan_quantities(patient, Plan("tiny", {})) == pytest.approx(dict.fromkeys(expected, 0), abs=1e-12)


def test_quantities_of_an_anatomy():
    patient = tiny_patient()
    patient = dataclasses.replace(patient, points=patient.points * [1, 2, 3])
    quality = {
        "volume_cm3": {"superficial": 5, "left": 1},
        "thickness_mm": {"cranium": None, "left": {"mean": 4.0, "p5": 1, "p95": 9}},
        "contact_cm2": {"left": {"moving": 2.0, "sliding": 0.5, "released": 7.0}},
    }
    quantities = anatomy_quantities(patient, quality)
    assert (quantities["width_mm"], quantities["height_mm"]) == pytest.approx((30, 45), abs=3)
    assert (quantities["volume_superficial_cm3"], quantities["thickness_left_mm"], quantities["contact_left_cm2"]) == (
        5,
        4,
        2.5,
    )
    assert np.isnan(quantities["thickness_cranium_mm"])
    json.dumps(Norm.of([quantities, quantities]).compare(quantities), allow_nan=False)
