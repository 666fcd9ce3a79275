"""Points, losses and targets of the surface networks, against closed forms."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from pinnochio.geometry.scattered import nearest, spread
from pinnochio.methods.surface.architectures import architecture as architecture_of
from pinnochio.methods.surface.losses import chamfer, density, laplacian_change, local_change
from pinnochio.methods.surface.patient import SurfacePatient, SurfaceTarget
from pinnochio.networks.clouds import FaceGraph, PointCloud, SurfaceStage, ball_edges
from pinnochio.plans.plan import Plan
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import surface_settings

SMALL = {"points": 64, "neighbours": 8}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def plate(height=0.0, count=12):
    x, y = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    return torch.tensor(np.stack([x, y, np.full_like(x, height, dtype=float)], -1).reshape(-1, 3), dtype=torch.float32)


def test_balls_hold_what_is_near_and_no_more_than_wished(rng):
    points, centres = rng.random((200, 3)), rng.random((20, 3))
    edges = ball_edges(points, centres, 0.3, 1000, rng)
    apart = np.linalg.norm(points[:, None] - centres, axis=2)
    assert {tuple(edge) for edge in edges.T} == {tuple(pair) for pair in np.argwhere(apart < 0.3)}
    few = ball_edges(points, centres, 0.3, 4, rng)
    assert np.bincount(few[1]).max() == 4 and (apart[few[0], few[1]] < 0.3).all()


def test_levels_are_subsets_that_shrink_and_values_come_back_up(rng):
    points = rng.random((300, 3))
    cloud = PointCloud.build(points, [100, 25], [0.3, 0.6], 16, rng)
    for level, finer in zip(cloud.levels, (cloud.points, cloud.levels[0].points), strict=True):
        assert cKDTree(finer.numpy()).query(level.points.numpy())[0].max() == 0
        assert level.near.shape == (len(finer), 3) and torch.allclose(level.weights.sum(1), torch.ones(len(finer)))
    level = cloud.levels[0]
    carried = spread(level.points, level.near, level.weights)
    assert (carried - cloud.points).norm(dim=1).mean() < 0.1
    index, weights = nearest(points, points)
    assert np.array_equal(index[:, 0], np.arange(300)) and weights[:, 0].min() > 0.99


def test_face_levels_cover_the_mesh_and_follow_each_other(rng):
    model = tiny_patient(0, (13, 9, 4))
    used, faces = np.unique(model.skin_faces, return_inverse=True)
    points = model.skin_points[used]
    graph = FaceGraph.build(points, np.tile([0, 0, 1.0], (len(points), 1)), faces.reshape(-1, 3), [60, 15, 4],
                            [12, 25, 60], 8, rng)  # fmt: skip
    sizes = [len(level.points) for level in graph.levels]
    assert sizes[0] <= 60 and sizes == sorted(sizes, reverse=True) and len(graph.triangles) > 40
    assert torch.allclose(graph.normals, torch.tensor([0, 0, 1.0]))
    for level, coarser in zip(graph.levels, graph.levels[1:], strict=False):
        assert sorted(set(level.trace.tolist())) == list(range(len(coarser.points)))
        assert (level.points - coarser.points[level.trace]).norm(dim=1).max() < 40
        both = {tuple(edge) for edge in level.mesh.T.tolist()}
        assert all((b, a) in both for a, b in both) and (level.ball[0] != level.ball[1]).all()
    assert len(graph.levels[-1].trace) == 0


def test_losses_of_two_plates():
    """Plates of unit squares, one 0.3 above the other: every distance is known."""
    one, two = plate(), plate(0.3)
    even = torch.ones(len(one))
    assert chamfer(one, two, even).item() == pytest.approx(0.6, abs=1e-5)
    assert chamfer(one, two, even, squared=True).item() == pytest.approx(0.18, abs=1e-5)
    assert density(one, one).item() == pytest.approx(0, abs=1e-5)
    assert density(one, two).item() > 0.05  # the nearest one of a target is no longer itself
    pairs = torch.tensor([[0, 1], [0, 12], [5, 17]])
    assert local_change(one, one @ torch.tensor([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]) + 7, pairs).item() < 1e-5
    assert local_change(one, 1.5 * one, pairs).item() == pytest.approx(0.5, abs=1e-5)
    assert local_change(one, one, pairs[:0]).item() == 0
    edges = torch.tensor([[0, 1, 2], [1, 2, 0]])
    assert laplacian_change(torch.ones(3, 3), edges).item() == 0
    assert laplacian_change(torch.tensor([[3.0, 0, 0], [0, 0, 0], [0, 0, 0]]), edges).item() == pytest.approx(6)


def test_what_the_scan_does_not_reach_has_no_weight():
    one, two = plate(), plate(0.3)
    seen = torch.ones(len(one))
    seen[0], moved = 0, one.clone()
    moved[0] = torch.tensor([-50.0, 0, 0])
    assert chamfer(moved, two, seen).item() < 0.61


def test_the_target_is_the_scan_over_the_judged_face():
    model = tiny_patient(0, (13, 9, 4), 6.0)
    settings = surface_settings("acmt", **SMALL)
    patient = SurfacePatient.build(model, settings, "P", 2)
    far = model.skin_points + [0, 0, 4.0]
    target = SurfaceTarget.build(patient, far, model.skin_faces, settings, "P")
    place = target.points.numpy() * patient.unit + patient.centre
    height = model.skin_points[np.unique(model.skin_faces), 2]
    assert height.min() + 3.9 < place[:, 2].min() and place[:, 2].max() < height.max() + 4.1
    for draw, seen in zip(patient.draws, target.seen, strict=True):
        rest = model.skin_points[draw.near[:, 0]]
        low, high = model.skin_points.min(0) + 4, model.skin_points.max(0) - 4
        inside = ((rest > low) & (rest < high))[:, :2].all(1)
        assert (seen.numpy()[inside] == 1).all()  # only the rim of the plate may look past the scan's border
    with pytest.raises(ValueError, match="covers nothing of the face"):
        SurfaceTarget.build(patient, far + [0, 500, 0], model.skin_faces[:2], settings, "P")


@pytest.mark.parametrize("architecture", ["acmt", "dgcfp"])
def test_no_motion_moves_no_bone_and_the_right_field_has_the_least_loss(architecture):
    model = tiny_patient(0, (13, 9, 4), 6.0)
    settings = surface_settings(architecture, **SMALL)
    patient = SurfacePatient.build(model, settings, "P", 1)
    draw = patient.draws[0]
    assert patient.inputs(draw, Plan("P", {})).movement.abs().max() == 0
    assert patient.inputs(draw, tiny_plan()).movement.abs().max() > 0
    shift = patient.carried(draw, np.tile([0.0, 0.0, 6.0], (len(model.skin_points), 1)))
    assert torch.allclose(shift * patient.unit, torch.tensor([0.0, 0, 6.0]).expand_as(shift), atol=1e-4)
    rest = draw.inputs.face.points
    even, batch = torch.ones(len(rest)), draw.inputs.batch
    edges = draw.inputs.face.levels[0].mesh if architecture == "dgcfp" else None
    losses = [
        architecture_of(settings)
        .loss([SurfaceStage(rest, share * shift, batch, edges)], draw.pairs, even, rest + shift)
        .item()
        for share in (0.0, 0.5, 1.0)
    ]
    assert losses[2] < losses[1] < losses[0]


def test_settings_that_cannot_be_are_refused():
    for wrong, words in (
        ({"architecture": "other"}, "not one of"),
        ({"architecture": "acmt", "points": 32}, "too few"),
    ):
        with pytest.raises(ValueError, match=words):
            surface_settings(**wrong)
