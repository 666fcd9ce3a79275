"""Loss terms against hand values, brute force and finite differences."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.methods.pinnochio import losses
from pinnochio.methods.pinnochio.losses import (
    FaceSamples,
    SurfaceLoss,
    border_nodes,
    boundary_loss,
    nearest,
    physics_loss,
    subdivision,
    volume_loss,
)
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.model.patient import FREE
from pinnochio.networks.signals import InterfaceAndVolume
from tests.helpers.patients import squares, tiny_patient
from tests.helpers.settings import network_settings


def tensors(scale=1.0, stiffness=1.0):
    model = tiny_patient()
    model = replace(model, points=model.points * scale, bone_points=model.bone_points * scale)
    material = neo_hookean(model.tissue, {MUSCLE: 6.0 * stiffness, SUPERFICIAL: 4.0 * stiffness}, 0.49, 0)
    return PatientTensors.build(model, material, "patch", network_settings())


@pytest.fixture(scope="module")
def patient():
    return tensors()


def noise(patient, sigma, seed=0):
    return sigma * torch.randn(patient.points.shape, generator=torch.Generator().manual_seed(seed))


def test_volume_loss_is_the_mean_squared_length():
    assert volume_loss(torch.tensor([[3.0, 4, 0], [0, 0, 0]]), torch.tensor([[0.0, 0, 0], [0, 0, 1]])) == 13


def test_boundary_loss_by_hand():
    displacement = torch.tensor([[1.0, 0, 0], [0, 2, 0], [9, 9, 9]])
    boundary = torch.tensor([[0.0, 0, 0], [0, 1, 0], [0, 0, 0]])
    known, anchored = torch.tensor([[1.0], [1], [0]]), torch.tensor([[0.0], [1], [1]])
    target = torch.tensor([[5.0, 5, 5], [0, 1, 3], [5, 5, 5]])
    # |u - u_bnd|^2 = 1, 1 over the two known nodes; |u_bnd - target|^2 = 9 on the one known and anchored node.
    assert boundary_loss(InterfaceAndVolume(displacement, boundary, known), target, anchored) == pytest.approx(1 + 9)


def test_physics_loss_is_zero_under_rigid_motion_and_positive_otherwise(patient):
    turn = torch.tensor(Rotation.from_euler("xyz", [5, -3, 4], degrees=True).as_matrix(), dtype=torch.float32)
    rigid = patient.points @ turn.T + torch.tensor([2.0, -1, 3]) - patient.points
    assert physics_loss(patient.operator, patient.free, rigid) < 1e-6
    assert physics_loss(patient.operator, patient.free, noise(patient, 0.1)) > 0.1


def test_physics_loss_is_the_scaled_mean_square_force_of_free_nodes(patient):
    u = noise(patient, 0.1)
    force = patient.operator.force(u).numpy()[patient.model.node_type == FREE]
    expected = (force.astype(float) ** 2).sum(1).mean() / patient.operator.force_scale**2
    assert physics_loss(patient.operator, patient.free, u).item() == pytest.approx(expected, rel=1e-4)


def test_physics_loss_has_no_unit(patient):
    """A mesh and field twice as large, or a tissue ten times as stiff, give the same number."""
    u = noise(patient, 0.1)
    expected = physics_loss(patient.operator, patient.free, u).item()
    large, stiff = tensors(scale=2.0), tensors(stiffness=10.0)
    assert physics_loss(large.operator, large.free, 2 * u).item() == pytest.approx(expected, rel=1e-3)
    assert physics_loss(stiff.operator, stiff.free, u).item() == pytest.approx(expected, rel=1e-3)


def grid(n, extent):
    """Square triangle mesh of n by n points in the plane z = 0."""
    axis = np.linspace(*extent, n)
    index = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)
    points = np.column_stack([index, np.zeros(n * n)])
    return points, squares(np.arange(n * n).reshape(n, n))


def surface(patient, shift=(0.0, 0.0, 0.0), **options):
    return SurfaceLoss(patient, patient.model.points + shift, patient.model.skin_faces, **options)


def test_chamfer_equals_brute_force(patient):
    u = noise(patient, 1.0)
    loss = surface(patient, (0.5, -0.3, 2.0), samples=500, cutoff=5.0)
    corners = (patient.points + u)[loss.faces].double()
    cloud = torch.einsum("sc,fcx->fsx", loss.weights.double(), corners).flatten(0, 1).numpy()
    rng = np.random.default_rng(7)
    here, there = loss.face.draw(rng, 500), loss.other.draw(rng, 500)
    apart = np.sqrt(((cloud[:, None] - loss.target.double().numpy()) ** 2).sum(2) + 1e-6)
    forward = [row.min() for row in apart[here] if row.min() < 5 and not loss.other.border[row.argmin()]]
    back = [row.min() for row in apart.T[there] if row.min() < 5 and not loss.face.border[row.argmin()]]
    assert 0 < len(forward) < 500 and 0 < len(back) < 500
    expected = (np.mean(forward) + np.mean(back)) / 2
    assert loss(u, np.random.default_rng(7)).item() == pytest.approx(expected, rel=1e-5)


def test_samples_are_ascending_and_in_proportion_to_area():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 3, 0]])
    samples = FaceSamples.build(10 * points, np.array([[0, 1, 2], [2, 1, 3]]))
    drawn = samples.draw(np.random.default_rng(0), 30000)
    assert (np.diff(drawn // len(samples.weights)) >= 0).all()
    assert (drawn >= len(samples.weights)).mean() == pytest.approx(2 / 3, abs=0.01)
    assert np.bincount(drawn).min() > 0


@pytest.mark.parametrize("pairs", [2**26, 7000])
def test_search_by_all_pairs_finds_what_the_tree_finds(monkeypatch, pairs):
    """With a small limit, in parts."""
    monkeypatch.setattr(losses, "PAIRS", pairs)
    random = torch.Generator().manual_seed(1)
    cloud = 100 + 10 * torch.randn(3000, 3, generator=random)
    queries = 100 + 20 * torch.randn(500, 3, generator=random)
    near, nearest_index = nearest(queries, cloud, 4.0)
    distance, index = losses.all_pairs(queries, cloud)
    assert 50 < len(near) < 450
    assert torch.equal(near, torch.nonzero(distance < 4.0)[:, 0]) and torch.equal(nearest_index, index[near])
    assert torch.equal(nearest(queries, cloud, 4.0, cKDTree(cloud.numpy()))[1], nearest_index)


def test_chamfer_pulls_the_skin_towards_the_target(patient):
    loss = surface(patient, (0.0, 0.0, 3.0))
    u = torch.zeros_like(patient.points, requires_grad=True)
    loss(u, np.random.default_rng(0)).backward()
    skin = np.unique(patient.model.skin_faces)
    assert (u.grad[skin, 2] <= 0).all() and u.grad[:, 2].sum() < -0.5
    assert u.grad[np.setdiff1d(np.arange(len(u)), skin)].abs().max() == 0


def test_chamfer_ignores_the_part_of_the_target_that_the_face_does_not_cover(patient):
    centre = patient.model.points[np.unique(patient.model.skin_faces)].mean(0)
    height = patient.model.points[:, 2].max() + 1
    values = []
    for reach in (40.0, 400.0):
        points, faces = grid(int(reach) + 1, (-reach, reach))
        loss = SurfaceLoss(patient, points + [*centre[:2], height], faces, samples=10**5)
        values.append(loss(torch.zeros_like(patient.points), np.random.default_rng(0)).item())
    assert values[0] == pytest.approx(values[1], rel=0.02)


def test_chamfer_refuses_a_target_out_of_reach(patient):
    loss = surface(patient, (0.0, 0.0, 100.0))
    with pytest.raises(ValueError, match="registered"):
        loss(torch.zeros_like(patient.points), np.random.default_rng(0))


def test_border_and_subdivision():
    _, faces = grid(4, (0, 1))
    inner = {5, 6, 9, 10}
    assert set(np.flatnonzero(~border_nodes(faces, 16))) == inner
    parts = subdivision(3)
    assert parts.shape == (9, 3) and np.allclose(parts.sum(1), 1) and parts.min() > 0
    assert np.allclose(parts.mean(0), 1 / 3)
    # Second moments of nine equal parts: the triangle's own (1/18 per coordinate) less the parts' (1/18 of 1/9 each).
    assert parts.var(0) == pytest.approx(np.full(3, 1 / 18 * (1 - 1 / 9)))
