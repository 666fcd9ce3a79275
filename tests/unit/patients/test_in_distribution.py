"""Whether a patient is like those of the training: by hand, by chance, and on the smallest patient."""

import dataclasses
import json

import numpy as np
import pytest

from pinnochio.model.bones import places
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
    ranges = Ranges(norm(0.0, 10.0, 40.0), norm(1.0, 2.0, from_rest=True), ["labelled"], ["lefort1"])
    ranges.write(tmp_path / "ranges.json")
    assert Ranges.read(tmp_path / "ranges.json") == ranges


def test_quantities_of_a_plan():
    """A turn about the middle of a place leaves that where it is; what the plan does not move has zeros."""
    patient = dataclasses.replace(tiny_patient(), segments=("lefort1",))
    middle = patient.bone_points[places(patient)["upper_incisors"]].mean(axis=0)
    quantities = plan_quantities(
        patient, Plan("tiny", {"lefort1": RigidMotion.from_degrees([3, 0, 4], [-2, -6, 1], middle)})
    )
    expected = {"sideways_upper_incisors_mm": 2, "forward_upper_incisors_mm": 6, "up_upper_incisors_mm": 1}
    expected["rotation_maxilla_deg"] = 5
    assert {name: quantities[name] for name in expected} == pytest.approx(expected)
    assert quantities["forward_upper_molars_left_mm"] != pytest.approx(6, abs=0.1)
    assert quantities["forward_chin_mm"] == quantities["rotation_mandible_deg"] == 0
    assert plan_quantities(patient, Plan("tiny", {})) == pytest.approx(dict.fromkeys(quantities, 0), abs=1e-12)


def test_a_cut_does_not_change_the_quantities_of_an_anatomy():
    """The same head with other cuts: volumes and contact of skull and lower jaw are sums, the thickness is weighted."""
    patient = tiny_patient()
    said = []
    for pieces in (
        {"lefort1": 0.4, "mandible": 0.6},
        {"lefort1_left": 0.1, "mandible_distal": 0.2, "proximal_left": 0.4},
    ):
        skull = 1 - sum(size for name, size in pieces.items() if name.startswith("lefort"))
        bones = {"cranium": skull} | pieces
        jaw = [name for name in pieces if not name.startswith("lefort")]
        share = sum(pieces[name] for name in jaw)
        bones |= {name: pieces[name] * 0.6 / share for name in jaw}
        quality = {
            "volume_cm3": {"superficial": 5, "muscle": 3} | {name: 10 * size for name, size in bones.items()},
            "thickness_mm": {name: {"mean": 4.0, "p5": 1, "p95": 9} for name in bones},
            "contact_cm2": {name: {"moving": size, "sliding": size, "released": 7.0} for name, size in bones.items()},
        }
        cut = dataclasses.replace(patient, segments=tuple(pieces))
        said.append(anatomy_quantities(cut, quality))
    assert said[0] == pytest.approx(said[1]) and said[0]["volume_lower_jaw_cm3"] == pytest.approx(6)


def test_quantities_of_an_anatomy():
    patient = tiny_patient()
    patient = dataclasses.replace(patient, points=patient.points * [1, 2, 3], segments=("mandible",))
    quality = {
        "volume_cm3": {"superficial": 5, "muscle": 2, "cranium": 8, "mandible": 1},
        "thickness_mm": {"cranium": None, "mandible": {"mean": 4.0, "p5": 1, "p95": 9}},
        "contact_cm2": {
            "cranium": {"fixed": 3.0, "released": 7.0},
            "mandible": {"moving": 2.0, "sliding": 0.5, "released": 7.0},
        },
    }
    quantities = anatomy_quantities(patient, quality)
    assert (quantities["width_mm"], quantities["height_mm"]) == pytest.approx((30, 45), abs=3)
    names = "volume_superficial_cm3", "thickness_lower_jaw_mm", "contact_lower_jaw_cm2", "contact_skull_cm2"
    assert [quantities[name] for name in names] == [5, 4, 2.5, 3]
    assert np.isnan(quantities["thickness_skull_mm"])
    json.dumps(Norm.of([quantities, quantities]).compare(quantities), allow_nan=False)
