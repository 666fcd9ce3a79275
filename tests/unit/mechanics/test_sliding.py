"""Sliding on planes, spheres and a patient's bone against closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary import conditions
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.sliding import SlidingSet, SlidingSurfaces
from pinnochio.mechanics.elements.materials import lame
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import FIXED, FREE, MOVING, SLIDING
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import slab_patient
from tests.helpers.settings import fem_settings
from tests.helpers.solids import both, plane, sphere


def nodes_on(points, normals, rest):
    """Nodes (s, 3) that slide on a surface at rest."""
    return SlidingSurfaces(rest, [SlidingSet(np.arange(len(rest)), points, normals, RigidMotion().fraction)])


def test_the_distance_is_exact_on_a_plane_and_close_on_a_sphere():
    rng = np.random.default_rng(0)
    points, normals = plane([1, 2, -0.5], [3.0, 1, 2])
    x = rng.uniform(-10, 10, (50, 3))
    bones = nodes_on(points, normals, x).bones
    np.testing.assert_allclose(bones.level, (x - [3.0, 1, 2]) @ normals[0], atol=1e-12)
    np.testing.assert_allclose(bones.frames[:, 0], np.tile(normals[0], (50, 1)), atol=1e-12)
    points, normals = sphere(20.0, 2000)
    away = rng.normal(size=(200, 3))
    x = away / np.linalg.norm(away, axis=1, keepdims=True) * rng.uniform(19, 22, (200, 1))
    bones = nodes_on(points, normals, x).bones
    np.testing.assert_allclose(bones.level, np.linalg.norm(x, axis=1) - 20, atol=5e-3)
    assert ((bones.frames[:, 0] * x).sum(axis=1) / np.linalg.norm(x, axis=1)).min() > 0.99999


def test_the_normal_is_the_gradient_and_nodes_return_to_their_level():
    x = np.random.default_rng(1).normal(size=(100, 3))
    x *= np.linspace(19, 21.5, 100)[:, None] / np.linalg.norm(x, axis=1, keepdims=True)
    sliding = nodes_on(*sphere(20.0, 500), x)
    held, steps = sliding.at(1.0), 1e-6 * np.eye(3)
    slope = np.stack([held.violation(x * 0 + step) - held.violation(x * 0 - step) for step in steps], axis=1)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    np.testing.assert_allclose(sliding.bones.frames[:, 0], slope, atol=1e-6)
    away = np.random.default_rng(2).normal(0, 0.7, x.shape)
    back = away.copy()
    held.project(back)
    gap = np.abs(held.violation(away))
    assert gap.max() > 1 and np.abs(held.violation(back)).max() < 1e-8
    np.testing.assert_allclose(np.linalg.norm(back - away, axis=1), gap, rtol=0.05)  # the shortest way


@both
def test_block_pressed_between_sliding_planes(volumetric):
    """An inclined plane presses a block against a fixed one; both slide, so the block is in uniaxial stress."""
    points, cells = box((12, 9, 9), (4, 3, 3), jitter=0.2)
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    points = points @ turn.T  # x of the block is the inclined normal turn[:, 0]
    mu, lam = lame(5.0, 0.49)
    stretch = 0.8
    across = brentq(lambda a: mu * (a**2 - 1) + lam * np.log(stretch * a**2), 0.9, 1.5, xtol=1e-14)
    f = turn @ np.diag([stretch, across, across]) @ turn.T
    exact = points @ (f - np.eye(3)).T
    local = points @ turn
    bottom, top = (np.flatnonzero(np.abs(local[:, 0] - x) < 1e-9) for x in (0, 12))
    prescribed = bottom[[0, 3]]  # the closed form itself: carries no reaction, stops the rigid motions
    # While it presses, the upper plane also travels and turns within itself: that must leave no trace.
    normal = turn[:, 0]
    motion = RigidMotion(
        Rotation.from_rotvec(0.4 * normal).as_matrix(), -2.4 * normal + 5.0 * turn[:, 1], turn @ [12.0, 2, 3]
    )
    fixed = SlidingSet(np.setdiff1d(bottom, prescribed), *plane(-normal, np.zeros(3)), RigidMotion().fraction)
    pressing = SlidingSet(top, *plane(normal, 12 * normal), motion.fraction)
    boundary = BoundaryConditions(prescribed, exact[prescribed], [fixed, pressing])
    law = uniform(len(cells))
    result = solve(points, cells, law, boundary, fem_settings(volumetric=volumetric, tolerance=1e-10))
    assert result.converged
    np.testing.assert_allclose(result.displacement, exact, rtol=0, atol=1e-7)
    assert result.violation < 1e-8
    force = Elements.build(points, cells, law, volumetric).evaluate(result.displacement)[1][top].sum(axis=0)
    nominal = mu * (stretch - 1 / stretch) + lam * np.log(stretch * across**2) / stretch
    np.testing.assert_allclose(force, nominal * 81 * normal, rtol=0, atol=1e-6 * abs(nominal * 81))


def shell():
    """A cap of tissue, 8 mm thick, over a sphere of 20 mm; rim fixed, inner side on the sphere."""
    flat, cells = box((1, 1, 8), (8, 8, 3))
    angle = (flat[:, :2] - 0.5) * 1.6
    points = np.stack([np.tan(angle[:, 0]), np.tan(angle[:, 1]), np.ones(len(flat))], axis=1)
    points *= ((20 + flat[:, 2]) / np.linalg.norm(points, axis=1))[:, None]
    rim = ((flat[:, :2] == 0) | (flat[:, :2] == 1)).any(axis=1)
    return points, cells, rim, (flat[:, 2] == 0) & ~rim


@both
def test_sliding_nodes_keep_their_distance_to_a_moved_sphere(volumetric):
    points, cells, rim, inner = shell()
    motion = RigidMotion.from_degrees([5.0, 0, 15], [2.5, 1.0, 2.0], [0, 0, 0])
    contact = SlidingSet(np.flatnonzero(inner), *sphere(20.0, 4000), motion.fraction)
    prescribed = np.flatnonzero(rim)
    law = uniform(len(cells))
    options = fem_settings(volumetric=volumetric, tolerance=1e-8)
    slid = solve(points, cells, law, BoundaryConditions(prescribed, np.zeros((len(prescribed), 3)), [contact]), options)
    assert slid.converged
    assert slid.violation < 0.01
    assert slid.iterations <= 12  # without the bend of the surface in the tangent each digit costs an iteration
    reached = np.linalg.norm((points + slid.displacement)[inner] - motion.apply(np.zeros((1, 3))), axis=1)
    np.testing.assert_allclose(reached, 20.0, atol=0.011)
    # Bonded to the sphere the tissue follows its turn and must be strained more.
    both_sets = np.flatnonzero(rim | inner)
    moved = np.where(inner[both_sets, None], motion.displacement(points[both_sets]), 0.0)
    bonded = solve(points, cells, law, BoundaryConditions(both_sets, moved), options)
    assert bonded.converged
    elements = Elements.build(points, cells, law, volumetric)
    energy = [elements.evaluate(result.displacement)[0] for result in (slid, bonded)]
    assert energy[0] < 0.8 * energy[1]
    # At the minimum nothing pulls along the sphere, while the sphere pushes along its normal.
    force = elements.evaluate(slid.displacement)[1][inner]
    held = SlidingSurfaces(points, [contact]).at(1.0)
    axes = np.einsum("sij,sj->si", held.frames(slid.displacement), force)
    assert np.abs(axes[:, 1:]).max() < 1e-2 * np.abs(axes[:, 0]).max()
    assert np.abs(held.violation(0 * points)).max() > 2  # and where nothing has moved, the gaps are reported


def test_arms_of_a_plan(monkeypatch):
    monkeypatch.setattr(conditions, "APART", 0.0)
    model = slab_patient()
    motion = RigidMotion.from_degrees([0, 4, 0], [3.0, -1, -1], [12, 6, 0])
    plan = Plan("P01", {"mandible_distal": motion})
    law = uniform(len(model.cells))
    carried, slides = model.node_segment == 1, model.node_type == SLIDING
    # No element can follow two bones: bonded, the nodes where one sliding zone meets the other stay free.
    bridging = np.isin(model.points[:, 0], (9, 12))
    fields = {}
    for arm in ("bonded", "mucosa"):
        boundary = boundary_conditions(model, plan, arm)
        result = solve(model.points, model.cells, law, boundary, fem_settings())
        assert result.converged
        fields[arm] = result.displacement
        prescribed = np.zeros(len(model.points), bool)
        prescribed[boundary.prescribed_nodes] = True
        assert prescribed[(model.node_type == MOVING) | (model.node_type == FIXED)].all()
        assert not prescribed[model.node_type == FREE].any()
        np.testing.assert_array_equal(prescribed[slides], ~bridging[slides] if arm == "bonded" else False)
        assert result.violation < 1e-6
    expected = motion.displacement(model.points)
    bonded = carried & slides & ~bridging
    np.testing.assert_allclose(fields["bonded"][bonded], expected[bonded], atol=1e-12)
    moving = carried & (model.node_type == MOVING)
    np.testing.assert_allclose(fields["mucosa"][moving], expected[moving], atol=1e-12)
    fixed = model.node_type == FIXED
    np.testing.assert_array_equal(fields["mucosa"][fixed], 0)
    # Sliding: on the moved plane, but not where the bone went.
    here = motion.inverse((model.points + fields["mucosa"])[carried & slides])
    np.testing.assert_allclose(here[:, 2], 0, atol=1e-6)
    assert np.linalg.norm((fields["mucosa"] - expected)[carried & slides], axis=1).max() > 0.3
    still = (model.node_segment == 0) & slides
    np.testing.assert_allclose(fields["mucosa"][still, 2], 0, atol=1e-6)
    assert np.abs(fields["mucosa"][still, 0]).max() > 0.05


@pytest.mark.parametrize(("apart", "free"), [(0, (9, 12)), (2.9, (9, 12)), (6.5, (6, 9, 12, 15))])
def test_bonded_nodes_near_the_other_jaw_are_free(apart, free, monkeypatch):
    model = slab_patient()
    others = boundary_conditions(model, Plan("P01", {}), "mucosa").prescribed_nodes
    monkeypatch.setattr(conditions, "APART", apart)
    boundary = boundary_conditions(model, Plan("P01", {}), "bonded")
    let = np.setdiff1d(np.flatnonzero(model.node_type == SLIDING), boundary.prescribed_nodes)
    assert set(model.points[let, 0]) == set(free) and (model.points[let, 1] < 4).all()
    # The other arms hold no sliding node to its bone anyway.
    np.testing.assert_array_equal(boundary_conditions(model, Plan("P01", {}), "mucosa").prescribed_nodes, others)


def test_bad_arms_plans_and_surfaces_are_refused():
    model = slab_patient()
    with pytest.raises(InputError, match="arm"):
        boundary_conditions(model, Plan("P01", {}), "glued")
    with pytest.raises(InputError, match="no segment"):
        boundary_conditions(model, Plan("P01", {"genioplasty": RigidMotion()}), "bonded")
    with pytest.raises(InputError, match="points"):
        nodes_on(np.zeros((2, 3)), np.ones((2, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="finite"):
        nodes_on(np.zeros((9, 3)), np.zeros((9, 3)), np.zeros((1, 3)))
    points, cells = box((6, 6, 6), (2, 2, 2))
    ends = np.array([0, 1, 2])
    contact = SlidingSet(ends, *plane([0, 0, 1], np.zeros(3)), RigidMotion().fraction)
    with pytest.raises(InputError, match="twice"):
        solve(points, cells, uniform(len(cells)), BoundaryConditions(ends, np.zeros((3, 3)), [contact]), fem_settings())


def plate(thickness=2.0, spacing=2.0):
    """Both faces of a thin plate, finely sampled in a corner and coarsely elsewhere."""
    coarse = np.stack(np.meshgrid(np.arange(-30, 31, 3 * spacing), np.arange(-30, 31, 3 * spacing)), -1).reshape(-1, 2)
    fine = np.stack(np.meshgrid(np.arange(-8, 9, spacing), np.arange(-8, 9, spacing)), -1).reshape(-1, 2) + 0.3
    flat = np.vstack([coarse, fine])
    faces = [np.column_stack([flat, np.full(len(flat), z)]) for z in (thickness / 2, -thickness / 2)]
    normals = np.zeros((2 * len(flat), 3))
    normals[: len(flat), 2], normals[len(flat) :, 2] = 1, -1
    return np.vstack(faces), normals


def test_the_surface_has_no_steps_where_points_lie_densely():
    """Along steps of 1e-3 mm the distance bends no more than a smooth field may: no point drops out with weight."""
    walk = np.column_stack([np.arange(-12, 12, 1e-3), np.full(24000, 0.7), np.full(24000, 1.6)])
    assert np.abs(np.diff(nodes_on(*plate(), walk).bones.level, 2)).max() < 1e-6


def test_nodes_reach_their_level_where_the_gradient_is_small():
    """Between two walls that face each other the gradient falls to nothing; the level is still met to 1e-9 mm."""
    points, normals = plate(thickness=4.0)
    rng = np.random.default_rng(0)
    start = np.column_stack([rng.uniform(-6, 6, (200, 2)), rng.uniform(0.15, 1.5, 200)])
    held = nodes_on(points, -normals, start).at(1.0)  # outward is into the gap
    rise = held.violation(0 * start + [0, 0, 1e-6]) - held.violation(0 * start - [0, 0, 1e-6])
    assert np.abs(rise / 2e-6).min() < 0.35
    u = rng.normal(0, 0.1, start.shape) * [1, 1, 0.5]
    held.project(u)
    assert np.abs(held.violation(u)).max() < 1e-9
