"""Scenes: the amplitude against closed forms, the cut and the bonded contact on a block, the parts of a plan."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.segmentation import Segmentation
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.model import patient as m
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL, segment_code
from pinnochio.plans.plan import Plan
from pinnochio.plans.scenarios import parts
from pinnochio.reduction.amplitude import amplitude
from pinnochio.reduction.decisions import decide
from pinnochio.reduction.models import bonded, cropped, single_layer
from pinnochio.tables.reductions import TRIALS, summarise
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings, scene_settings

ONES, ZERO = np.ones(3), np.zeros(3)
FEM = fem_settings(poisson=0.45)
JAWS = ("lefort1", "mandible_distal")


def moved(**shifts):
    return Plan("-", {name: RigidMotion(translation=np.array(shift, float)) for name, shift in shifts.items()})


def rod(count=42, thick=6):
    """A rod of tissue in air along x, moving bone at one end and cranium at the other."""
    labels = np.zeros((count, thick + 8, thick + 8), np.uint8)
    inner = (slice(4, 4 + thick),) * 2
    labels[4:-4, *inner] = SUPERFICIAL
    labels[2:4, *inner] = segment_code(0)
    labels[-4:-2, *inner] = CRANIUM
    return labels


def along(field):
    """Amplitude of the blocks along the middle of the rod, and their places (voxels)."""
    value = field.value[:, field.value.shape[1] // 2, field.value.shape[2] // 2]
    return value, 2 * np.arange(len(value)) + 0.5


def test_amplitude_falls_linearly_along_a_rod_and_follows_the_length_of_the_motion():
    labels = rod()
    field = amplitude(labels, ONES, ZERO, ("jaw",), moved(jaw=(0, 3, 4)), ("jaw",), [], 18, 0)
    value, place = along(field)
    inside = (place > 4) & (place < 37)
    np.testing.assert_allclose(value[inside], np.interp(place[inside], [2.5, 38.5], [5, 0]), atol=1e-3)
    assert field.voxels().shape == labels.shape and field.voxels()[10, 7, 7] > 2.5 > field.voxels()[30, 7, 7]
    np.testing.assert_allclose(field.at(np.array([20.2, 7, 7]), ONES, ZERO), field.voxels()[20, 7, 7])


def test_a_gap_separates():
    labels = rod()
    labels[20:22] = AIR
    field = amplitude(labels, ONES, ZERO, ("jaw",), moved(jaw=(5, 0, 0)), ("jaw",), [], 18, 0)
    value, place = along(field)
    np.testing.assert_allclose(value[(place > 4) & (place < 20)], 5, atol=1e-3)
    np.testing.assert_allclose(value[(place > 22) & (place < 37)], 0, atol=1e-3)


def test_bone_that_stays_lets_go_where_it_opposes_a_moving_segment_or_is_near_the_osteotomy():
    labels = rod()
    labels[4:-4, 10:12, 4:10] = segment_code(1)  # a plate along the rod
    plan = moved(lefort1=(5, 0, 0))
    fixed = amplitude(labels, ONES, ZERO, JAWS, plan, ("lefort1",), [], 60, 0)
    slides = amplitude(labels, ONES, ZERO, JAWS, plan, ("lefort1",), [(0, 1)], 60, 0)
    near = amplitude(labels, ONES, ZERO, JAWS, plan, ("lefort1",), [], 60, 12)
    bare = amplitude(np.where(labels == segment_code(1), AIR, labels), ONES, ZERO, JAWS, plan, ("lefort1",), [], 18, 0)
    middle = fixed.value[10, 3, 3], near.value[10, 3, 3], slides.value[10, 3, 3]
    assert middle[0] < 0.2 < middle[1] < middle[2]
    np.testing.assert_allclose(slides.value[4:18, 3, 3], bare.value[4:18, 3, 3], atol=1e-2)


def test_cropped_leaves_the_rest_to_the_bit_and_holds_the_cut():
    patient, plan = tiny_patient(shape=(16, 5, 4)), tiny_plan()
    x = patient.points[patient.cells].mean(axis=1)[:, 0]
    part = cropped(patient, x < 70)
    kept = np.flatnonzero((patient.points[:, None] == part.points).all(axis=2).any(axis=1))
    np.testing.assert_array_equal(patient.points[kept], part.points)
    assert 0.5 < len(part.points) / len(patient.points) < 0.9
    np.testing.assert_array_equal(kept[part.cells], patient.cells[x < 70])
    cut = np.isin(kept, patient.cells[x >= 70])
    assert cut.any() and (part.node_type[cut] == m.FIXED).all() and (part.node_beyond[cut] == m.CUT_PLANE).all()
    np.testing.assert_array_equal(part.node_type[~cut], patient.node_type[kept][~cut])
    field = np.random.default_rng(0).normal(size=patient.points.shape)
    field[np.setdiff1d(np.arange(len(field)), kept)] = 0
    np.testing.assert_allclose(part.moved_skin(field[kept]), patient.moved_skin(field), atol=1e-12)
    np.testing.assert_array_equal(part.skin_faces, patient.skin_faces)
    result = simulate(part, plan, "mucosa", FEM)
    assert result.converged and np.abs(result.displacement[cut]).max() == 0


def test_a_piece_without_moving_bone_is_left_out():
    patient = tiny_patient(shape=(16, 5, 4))
    x = patient.points[patient.cells].mean(axis=1)[:, 0]
    sides = cropped(patient, (x < 50) | (x > 82))  # beyond 80 mm there is nothing but cranium
    alone = cropped(patient, x < 50)
    assert (patient.node_type[patient.points[:, 0] > 80] != m.MOVING).all()
    np.testing.assert_array_equal(sides.points, alone.points)


def test_bonded_holds_what_the_bonded_arm_holds():
    patient, plan = tiny_patient(), tiny_plan()
    reduced = bonded(patient)
    assert (patient.node_type == m.SLIDING).any() and not (reduced.node_type == m.SLIDING).any()
    one, two = boundary_conditions(reduced, plan, "mucosa"), boundary_conditions(patient, plan, "bonded")
    np.testing.assert_array_equal(one.prescribed_nodes, two.prescribed_nodes)
    np.testing.assert_array_equal(one.displacement(1.0), two.displacement(1.0))
    assert not one.sliding


def test_single_layer_is_one_tissue():
    reduced = single_layer(tiny_patient())
    assert set(reduced.tissue) == {SUPERFICIAL} and reduced.muscle == "single"
    assert not np.isin(reduced.interface_kind, (m.BONE_MUSCLE, m.MUSCLE_SUPERFICIAL)).any()
    assert (reduced.interface_kind == m.BONE_SUPERFICIAL).any()


def head_of(patient):
    """Labels around the tiny patient: tissue above its plate of bone."""
    low = patient.bone_points.min(axis=0).round() - [2, 2, 3]
    shape = np.ceil(np.ptp(patient.bone_points, axis=0)).astype(int) + [5, 5, 24]
    labels = np.full(shape, SUPERFICIAL, np.uint8)
    labels[..., -4:] = AIR
    labels[..., :3] = np.where(low[0] + np.arange(shape[0]) < 35, segment_code(0), CRANIUM)[:, None, None]
    labels[:6, :, 3:8] = MUSCLE
    return Segmentation(labels, ONES, low)


def test_decisions_name_their_numbers_and_obey_the_hand():
    patient = tiny_patient(shape=(16, 5, 4))
    head = head_of(patient)

    def decided(plan, **settings):
        return decide(patient, head, plan, scene_settings(**settings), FEM, 18, 5)[0]

    far, near = decided(tiny_plan()), decided(tiny_plan(0.3, 0, 0, 0))
    assert far["segments"].value == ("left",) and "left 3" in far["segments"].reason
    assert far["region"].value and "% of the tissue can move by more than 0.0" in far["region"].reason
    assert not far["elastic"].value and near["elastic"].value and "0.30 mm" in near["elastic"].reason
    assert not far["single_layer"].value and near["single_layer"].value
    still = decided(tiny_plan(0.05, 0, 0, 0))
    assert still["segments"].value == () and not still["region"].value and still["elastic"].value
    hand = decided(tiny_plan(), elastic=True, region=False)
    assert hand["elastic"].value and not hand["region"].value
    assert hand["elastic"].by == "hand" and hand["bonded"].by == "auto"
    with pytest.raises(InputError, match="there is no 'chin'"):
        decided(tiny_plan(), segments=["chin"])


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


def test_summary_keeps_the_worst_patient_and_the_worst_point():
    row = {column.name: 1 if column.kind in (int, float) else "x" for column in TRIALS} | {"converged": True}
    rows = [row | {"error_mean": 0.1, "error_max": 0.4}, row | {"case": "B", "error_mean": 0.3, "error_max": 0.2}]
    summary = summarise(pd.DataFrame([*rows, row | {"model": "y", "converged": False, "made": ""}]))
    assert summary["model"].tolist() == ["x", "y"] and summary["n"].tolist() == [2, 1]
    assert summary["failed"].tolist() == [0, 1]
    assert summary.loc[0, ["error_mean", "error_mean_max", "error_max"]].tolist() == pytest.approx([0.2, 0.3, 0.4])
