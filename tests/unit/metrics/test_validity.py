"""Volume, equilibrium, boundary and truth errors against closed forms."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import check
from pinnochio.errors import InputError
from pinnochio.geometry.interpolation import interpolate
from pinnochio.mechanics.elements.tetrahedra import jacobians, node_volumes, shape_gradients
from pinnochio.mechanics.problems import box
from pinnochio.mechanics.simulation import simulate
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.evaluation import CaseJudge
from pinnochio.metrics.judged import choose
from pinnochio.metrics.validity import (
    EDGE,
    beside_edge,
    boundary_metrics,
    equilibrium_metrics,
    equilibrium_of,
    volume_metrics,
)
from pinnochio.metrics.volume import mean_and_p95
from pinnochio.model.patient import BONE_MUSCLE, CUT_PLANE, FIXED, FREE, INTERIOR, MOVING, SLIDING, PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.model.truth import TrueMotion
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings


def test_a_uniform_stretch_has_the_determinant_of_its_gradient():
    points, cells = box((40, 40, 40), (4,) * 3)
    stretch = np.array([[1.1, 0.2, 0], [0, 0.9, 0.1], [0, 0, 1.05]])
    ratio, rest = jacobians(points, cells, points @ stretch.T - points), shape_gradients(points, cells)[1]
    np.testing.assert_allclose(ratio, np.linalg.det(stretch), rtol=1e-12)
    assert rest.sum() == pytest.approx(40.0**3)


def test_volume_change_is_by_tissue_and_inverted_elements_are_counted():
    points, cells = box((40, 40, 40), (4,) * 3)
    upper = points[cells].mean(axis=1)[:, 2] > 20
    tissue = np.where(upper, 1, 2).astype(np.int8)
    u = np.zeros_like(points)
    above = points[:, 2] >= 20
    u[above, 2] = 0.1 * (points[above, 2] - 20)  # upper half 10% taller
    metrics = volume_metrics(points, cells, tissue, u)
    assert metrics["volume_change_superficial"] == pytest.approx(10)
    assert metrics["volume_change_muscle"] == pytest.approx(0, abs=1e-9)
    assert metrics["min_jacobian"] == pytest.approx(1) and metrics["inverted"] == 0
    u[62] += [0, 0, 25]  # the middle node through its upper neighbours
    ratio = jacobians(points, cells, u)
    metrics = volume_metrics(points, cells, tissue, u)
    assert metrics["inverted"] == (ratio <= 0).sum() > 0 and metrics["min_jacobian"] == ratio.min() < 0
    assert metrics["p1_jacobian"] == pytest.approx(np.percentile(ratio, 1))
    assert np.isnan(volume_metrics(points, cells, np.ones_like(tissue), u)["volume_change_muscle"])


def springs(stiffness, u):
    """Internal force and diagonal blocks where every node hangs on its own springs: force k u."""
    return stiffness * u, stiffness[:, :, None] * np.eye(3)


def test_the_four_forms_of_eqres_by_hand():
    stiffness = np.array([[1.0, 1, 1], [2, 2, 2], [1, 4, 1], [5, 5, 5]])
    u = np.array([[3.0, 4, 0], [0, 0, 1], [0, 2, 0], [0, 0, 2]])  # forces 5, 2, 8 | 10
    kinds = np.array([FREE, FREE, FREE, FIXED])
    metrics = equilibrium_metrics(*springs(stiffness, u), kinds)
    assert metrics["eqres_paper"] == pytest.approx((25 + 4 + 64) / 3)
    assert metrics["eqres_rms"] == pytest.approx(np.sqrt(31))
    assert metrics["eqres_rel"] == pytest.approx(np.sqrt(93) / 10)
    assert metrics["eqres_disp"] == pytest.approx((5 + 1 + 2) / 3)
    sliding = equilibrium_metrics(*springs(stiffness, u), np.array([FREE, FREE, SLIDING, MOVING]))
    assert sliding["eqres_rel"] == pytest.approx(np.sqrt(29 / 164))


def test_eqres_of_rest_and_of_reactions_alone():
    stiffness, kinds = np.ones((3, 3)), np.array([FREE, FREE, FIXED])
    rest = equilibrium_metrics(*springs(stiffness, np.full((3, 3), 1e-13)), kinds)
    assert rest["eqres_rel"] == 0 and rest["eqres_paper"] < 1e-20
    u = np.zeros((3, 3))
    u[2] = 1
    assert equilibrium_metrics(*springs(stiffness, u), kinds)["eqres_rel"] == 0
    assert equilibrium_metrics(*springs(stiffness, u[::-1]), kinds)["eqres_rel"] == np.inf


@pytest.fixture(scope="module")
def patient():
    """Cube of tissue on a plate of bone (segment "jaw", z = 0 on top): the bottom moves or slides."""
    points, cells = box((40, 40, 40), (4,) * 3)
    kind = np.full(len(points), FREE, np.int8)
    bottom = points[:, 2] == 0
    kind[bottom & (points[:, 0] < 20)] = MOVING
    kind[bottom & (points[:, 0] >= 20)] = SLIDING
    kind[points[:, 1] == 40] = FIXED
    attached = np.isin(kind, (MOVING, SLIDING))
    bone = np.stack(np.meshgrid(np.arange(-9, 60, 4.0), np.arange(-9, 60, 4.0), [0.0]), -1).reshape(-1, 3)
    thin = bone - [0, 0, 5]  # its far side, which faces away from the tissue
    top = np.flatnonzero(points[:, 2] == 40).reshape(5, 5)
    a, b, c, d = top[:-1, :-1].ravel(), top[1:, :-1].ravel(), top[1:, 1:].ravel(), top[:-1, 1:].ravel()
    return PatientModel(
        points=points,
        cells=cells,
        tissue=np.where(points[cells].mean(axis=1)[:, 2] > 20, 1, 2).astype(np.int8),
        node_type=kind,
        node_segment=np.where(attached, 0, -1).astype(np.int8),
        node_beyond=np.where(attached, 11, -1).astype(np.int16),
        node_normal=np.where(attached[:, None], [0, 0, -1.0], 0),
        interface_kind=np.where(attached, BONE_MUSCLE, 0).astype(np.int8),
        skin_faces=np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32),
        face_roi=np.ones(32, bool),
        bone_points=np.vstack([bone, thin]),
        bone_normals=np.repeat([[0, 0, 1.0], [0, 0, -1.0]], len(bone), axis=0),
        bone_faces=np.zeros((0, 3), np.int32),
        bone_segment=np.zeros(2 * len(bone), np.int8),
        segments=("jaw",),
    )


def test_boundary_errors_are_zero_for_the_rigid_motion_and_count_gap_and_penetration(patient):
    motion = RigidMotion.from_degrees([4, 0, 0], [3, 0, -2], [10, 10, 0])
    plan = Plan("P1", {"jaw": motion})
    rigid = motion.displacement(patient.points)
    metrics = boundary_metrics(patient, plan, rigid)
    assert metrics["moving_error"] < 1e-12 and metrics["sliding_error"] < 1e-9
    normal = motion.rotation @ [0, 0, 1.0]
    slid = rigid + motion.rotation @ [5.0, 0, 0]  # along the bone: free for sliding nodes, wrong for moving ones
    metrics = boundary_metrics(patient, plan, slid)
    assert metrics["moving_error"] == pytest.approx(5) and metrics["sliding_error"] < 1e-4
    side = np.where(np.arange(len(rigid)) % 2, 0.5, -0.7)[:, None]
    metrics = boundary_metrics(patient, plan, rigid + side * normal)
    expected = np.abs(side[patient.node_type == SLIDING]).mean()
    assert metrics["sliding_error"] == pytest.approx(expected, abs=1e-3)
    deeper = replace(patient, bone_points=patient.bone_points - [0, 0, 2])  # tissue rests 2 mm off the bone
    metrics = boundary_metrics(deeper, plan, rigid + 0.4 * normal)
    assert metrics["sliding_error"] == pytest.approx(0.4, abs=1e-3)
    assert boundary_metrics(patient, Plan("P1", {}), np.zeros_like(rigid))["moving_error"] == 0


def test_converged_sliding_finite_elements_slide_exactly_as_far_as_the_solver_holds_them():
    """To the solver's own 1e-9 mm; the same field off the bone by a tenth of a millimetre is off by that."""
    tiny, plan = tiny_patient(3), tiny_plan()
    (solved,) = simulate(tiny, [plan], fem_settings())
    assert solved.converged and np.abs(solved.displacement[tiny.node_type == SLIDING]).max() > 1
    metrics = boundary_metrics(tiny, plan, solved.displacement)
    assert metrics["sliding_error"] < 1e-8 and metrics["moving_error"] < 1e-9
    normal = plan.motion("left").rotation @ [0, 0, 1.0]
    off = boundary_metrics(tiny, plan, solved.displacement + 0.1 * normal)
    assert off["sliding_error"] == pytest.approx(0.1, abs=0.01)


def test_how_much_of_the_face_lies_beside_the_edge_of_the_scan():
    patient = tiny_patient()
    moved = np.full(len(patient.judged_points), 5.0)
    beyond = np.full(len(patient.points), INTERIOR, np.int16)
    inside = beside_edge(replace(patient, node_beyond=beyond), moved)
    assert inside == {"edge_percent": 0.0, "edge_moved_mm": 0.0}
    corner = patient.skin_points[patient.judged_points[0]]
    beyond[np.argmin(np.linalg.norm(patient.points - corner, axis=1))] = CUT_PLANE
    away = np.linalg.norm(patient.skin_points[patient.judged_points] - patient.points[beyond == CUT_PLANE], axis=1)
    moved[away > EDGE] = 9.0  # elsewhere does not count
    said = beside_edge(replace(patient, node_beyond=beyond), moved)
    assert said == {"edge_percent": pytest.approx(100 * (away <= EDGE).mean()), "edge_moved_mm": pytest.approx(5.0)}


def test_a_linear_field_is_interpolated_exactly_and_outside_by_the_closest_point():
    points, cells = box((40, 40, 40), (3,) * 3)
    gradient, shift = np.array([[0.1, 0.02, 0], [0, -0.1, 0.3], [0.2, 0, 0.05]]), [1.0, 2, 3]
    queries = np.random.default_rng(0).uniform(0, 40, (200, 3))
    interpolated = interpolate(queries, points, cells, points @ gradient.T + shift)
    np.testing.assert_allclose(interpolated, queries @ gradient.T + shift, atol=1e-8)
    outside = np.array([[50.0, 20, 10], [-3, -4, 45]])
    interpolated = interpolate(outside, points, cells, points @ gradient.T + shift)
    np.testing.assert_allclose(interpolated, np.clip(outside, 0, 40) @ gradient.T + shift, atol=1e-8)


def test_the_truth_is_read_on_another_mesh(patient, tmp_path):
    other, other_cells = box((40, 40, 40), (5,) * 3)
    finer = replace(patient, skin_points=patient.skin_points[:3] + 1.0)  # a skin has points of its own
    path = tmp_path / "true_motion.h5"
    TrueMotion.of(finer, other, other_cells, other * [0.1, 0, 0]).write(path)
    truth = TrueMotion.read(path, finer, "P1")
    np.testing.assert_allclose(truth.nodes, patient.points * [0.1, 0, 0], atol=1e-8)
    np.testing.assert_allclose(truth.skin, finer.skin_points * [0.1, 0, 0], atol=1e-8)
    with pytest.raises(InputError, match="P1.*true_motion.h5: it is of another mesh: .*Remedy: delete it"):
        TrueMotion.read(path, patient, "P1")


def test_errors_are_means_over_volume_however_dense_the_nodes_are():
    """Nodes crowded at one end, where the error is small, do not make the mean smaller."""
    points, cells = box((40, 40, 40), (8,) * 3)
    crowded = points.copy()
    crowded[:, 2] = 40 * (points[:, 2] / 40) ** 2
    for nodes in (points, crowded):
        volumes = node_volumes(nodes, cells)
        assert volumes.sum() == pytest.approx(40**3) and volumes.min() > 0
        metrics = mean_and_p95("volume_error", nodes[:, 2], volumes)
        assert metrics["volume_error_mean"] == pytest.approx(20) and metrics["volume_error_p95"] >= 35
    assert crowded[:, 2].mean() < 16


LABELS = {"fold": "1", "method": "m", "code": "c", "registration_residual": 0.2}


def test_one_case_gives_one_complete_row(patient):
    top = patient.skin_faces
    target = patient.points + [0, 0, 1.5], top
    plan = Plan("P1", {"jaw": RigidMotion()})
    judged = choose(patient, plan, *target, 500, 1)
    fem = fem_settings()
    options = {"fem": fem, "seed": 1, "labels": LABELS}
    truth = TrueMotion.of(patient, patient.points, patient.cells, np.full_like(patient.points, 2.0))
    judge = CaseJudge(patient, target=target, judged=judged, truth=truth, **options)
    row = judge.row(plan, Prediction(np.zeros_like(patient.points)))
    assert (row["target_samples"], row["skin_samples"]) == (len(judged.target), len(judged.skin))
    assert row["cd"] == pytest.approx(1.5) and row["pwr1"] == 0 and row["pwr2"] == 100
    assert row["min_jacobian"] == pytest.approx(1) and row["eqres_rel"] == 0 and row["moving_error"] == 0
    assert row["volume_error_mean"] == pytest.approx(2 * np.sqrt(3)) and row["nodes"] == 125
    assert row["skin_error_mean"] == row["skin_error_p95"] == pytest.approx(2 * np.sqrt(3))
    assert np.isnan(row["region_nose"]) and np.isnan(row["landmark_menton"])  # a cube has no face
    assert list(check(pd.DataFrame([row]), CASES)) == [column.name for column in CASES]
    skin = judge.row(plan, Prediction(None, skin=np.zeros_like(patient.skin_points)))
    assert (skin["cd"], skin["skin_error_mean"]) == (row["cd"], row["skin_error_mean"])
    assert np.isnan([skin["volume_error_mean"], skin["min_jacobian"]]).all()
    check(pd.DataFrame([skin]), CASES)
    bare = CaseJudge(patient, **options).row(plan, Prediction(np.zeros_like(patient.points)))
    assert np.isnan(bare["cd"]) and np.isnan(bare["volume_error_mean"]) and bare["converged"]
    lost = judge.row(plan, Prediction(np.full_like(patient.points, np.nan)))
    assert not lost["converged"] and np.isnan(lost["cd"]) and "not finite" in lost["reason"]


def test_eqres_of_a_uniform_stretch_is_zero_inside_and_of_a_kicked_node_is_not(patient):
    fem = fem_settings(youngs_modulus={"superficial": 6.0, "muscle": 6.0})
    kinds = np.where(((patient.points > 0) & (patient.points < 40)).all(axis=1), FREE, FIXED).astype(np.int8)
    stretch = patient.points * [0.05, -0.02, 0.01]
    patient = replace(patient, node_type=kinds)
    metrics = equilibrium_of(patient, stretch, fem)
    assert metrics["eqres_rel"] < 1e-9 and metrics["eqres_disp"] < 1e-9
    kicked = stretch.copy()
    kicked[62] += [0, 0, 0.3]
    metrics = equilibrium_of(patient, kicked, fem)
    assert metrics["eqres_rel"] > 1e-2 and metrics["eqres_element"] == "patch"
