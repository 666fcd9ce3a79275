"""Sliding on an inclined plane and on a cylinder against closed forms, in a tilted frame."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.sliding import SlidingSet
from pinnochio.mechanics.elements.materials import Material, lame
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.problems import box
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.plans.plan import RigidMotion
from tests.helpers.settings import fem_settings
from tests.helpers.solids import both, extruded, plane, solved

TILT = Rotation.from_rotvec([0.5, -0.8, 0.3]).as_matrix()


# ---- inclined plane


@both
@pytest.mark.parametrize("along", [6.0, -6.0], ids=["lifts", "pulls"])
def test_wedge_driven_under_a_block(volumetric, along):
    """A block glued to a plate stands on a slope of 30 degrees; driven by d along the horizontal the slope rises by
    d sin 30 under the block, which is so in uniaxial stress: without lateral strain, as lam = 0. In the block's axes
    F = diag(1, 1, s) and P = mu (s - 1/s). The plate meanwhile carries the block 7 mm sideways, which leaves no trace.
    """
    points, cells = box((9, 8, 12), (3, 3, 4), jitter=0.2)
    height, mu = points[:, 2].copy(), 2.0
    count = len(cells)
    law = Material(np.full(count, mu), np.full(count, 1e-9), np.zeros(count))
    slope = Rotation.from_rotvec([0, np.deg2rad(30), 0]).as_matrix()
    turn = TILT @ slope  # the block's z is the normal of the slope; TILT's x is the horizontal
    points, normal, aside = points @ turn.T, turn[:, 2], 7.0 * turn[:, 1]
    top, bottom = np.flatnonzero(height == 12), np.flatnonzero(height == 0)
    drive = RigidMotion(translation=along * TILT[:, 0])
    boundary = BoundaryConditions(
        top,
        np.tile(aside, (len(top), 1)),
        [SlidingSet(bottom, *plane(normal, np.zeros(3), half=60.0, step=3.0), drive.fraction)],
    )
    result = solve(
        points, cells, law, boundary, fem_settings(volumetric=volumetric, tolerance=1e-10, min_increment=1 / 16)
    )
    assert result.converged
    rise = along * np.sin(np.deg2rad(30))
    expected = aside + np.outer(rise * (1 - height / 12), normal)
    np.testing.assert_allclose(result.displacement, expected, rtol=0, atol=1e-7)
    assert result.violation < 1e-8
    force = Elements.build(points, cells, law, volumetric).evaluate(result.displacement)[1]
    stretch = 1 - rise / 12
    push = mu * (stretch - 1 / stretch) * 72
    np.testing.assert_allclose(force[bottom].sum(axis=0), -push * normal, rtol=0, atol=1e-6 * abs(push))
    # No shear traction: every node of the slope is pushed along its normal alone.
    shear = force[bottom] - np.outer(force[bottom] @ normal, normal)
    assert np.abs(shear).max() < 1e-8 * abs(push)


# ---- a tube of tissue on a rigid cylinder

INSIDE, OUTSIDE, LENGTH = 10.0, 16.0, 9.0  # mm


def tube(around=24, along=3, across=5):
    """Points and cells of a tube along z, and the radius and height of each node."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(along), indexing="ij"))
    corners = [((i + di) % around) * (along + 1) + j + dj for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    triangles = np.vstack([np.stack([corners[k] for k in which], axis=1) for which in ((0, 1, 2), (0, 2, 3))])
    turn, z = np.meshgrid(2 * np.pi * np.arange(around) / around, np.linspace(0, LENGTH, along + 1), indexing="ij")
    radii = np.linspace(INSIDE, OUTSIDE, across + 1)[:, None]
    layers = np.stack([radii * np.cos(turn).ravel(), radii * np.sin(turn).ravel(), 0 * radii + z.ravel()], axis=-1)
    points, cells = extruded(layers, triangles)
    return points, cells, np.hypot(*points[:, :2].T), points[:, 2].copy()


def cylinder(count=6000, reach=15.0):
    """Points and outward normals of the cylinder, tilted; a spiral, so that no turn or shift maps it onto itself."""
    k = np.arange(count) + 0.5
    turn = np.pi * (1 + 5**0.5) * k
    normals = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    points = INSIDE * normals + np.outer(-reach + (LENGTH + 2 * reach) * k / count, [0, 0, 1])
    return points @ TILT.T, normals @ TILT.T


def about_axis(degrees, along=0.0, aside=(0.0, 0.0)):
    """Motion that turns about the tilted axis, shifts along it and moves it aside."""
    turn = TILT @ Rotation.from_rotvec([0, 0, np.deg2rad(degrees)]).as_matrix() @ TILT.T
    return RigidMotion(turn, TILT @ [*aside, along])


@pytest.mark.parametrize(
    ("spin", "carry"),
    [
        (about_axis(50, 6.0), about_axis(0)),
        (about_axis(0), about_axis(35, -5.0)),
        (about_axis(-40, 4.0, (5.0, -3.0)), about_axis(30, -2.0, (5.0, -3.0))),
    ],
    ids=["the cylinder turns", "the tissue turns", "both turn while the axis moves"],
)
def test_a_tube_slips_on_a_cylinder_without_trace(spin, carry):
    """A cylinder maps to itself under turns about its axis and shifts along it: the tissue follows its outer surface
    as a rigid body, whatever the cylinder does so."""
    points, cells, radius, _ = tube()
    points = points @ TILT.T
    outer, inner = np.flatnonzero(radius > OUTSIDE - 1e-9), np.flatnonzero(radius < INSIDE + 1e-9)
    boundary = BoundaryConditions(
        outer, lambda t: carry.fraction(t).displacement(points[outer]), [SlidingSet(inner, *cylinder(), spin.fraction)]
    )
    result, force = solved(points, cells, boundary)
    np.testing.assert_allclose(result.displacement, carry.displacement(points), rtol=0, atol=1e-6)
    assert np.abs(force).max() < 1e-5  # mN


def pressed(squeeze, poisson):
    """r(R) and radial stress (Cauchy, kPa) on the cylinder of a tube in plane strain whose outer radius shrinks.

    dP_r/dR + (P_r - P_t)/R = 0 with P_i = mu (l_i - 1/l_i) + lam ln J / l_i, l_r = r', l_t = r/R, J = l_r l_t.
    """
    mu, lam = lame(5.0, poisson)

    def nominal(stretch, log):
        return mu * (stretch - 1 / stretch) + lam * log / stretch

    def slope(rest, state):
        radius, along = state
        around = radius / rest
        log = np.log(along * around)
        stiffness = mu * (1 + along**-2) + lam * (1 - log) / along**2
        pull = nominal(along, log) - nominal(around, log) + lam * (along - around) / (along * around)
        return np.stack([along, -pull / (rest * stiffness)])

    def ends(inner, outer):
        return np.array([inner[0] - INSIDE, outer[0] - (OUTSIDE - squeeze)])

    rest = np.linspace(INSIDE, OUTSIDE, 31)
    guess = INSIDE + (rest - INSIDE) * (1 - squeeze / (OUTSIDE - INSIDE))
    profile = solve_bvp(slope, ends, rest, np.stack([guess, np.gradient(guess, rest)]), tol=1e-8)
    assert profile.success
    along = profile.sol(INSIDE)[1]  # the stretch around is 1 there, so that Cauchy stress and P_r are the same
    return lambda at: profile.sol(at)[0], nominal(along, np.log(along))


@both
@pytest.mark.parametrize("squeeze", [1.2, -1.2], ids=["pressed", "pulled"])
def test_a_tube_pressed_onto_a_cylinder_turns_with_its_outer_surface(squeeze, volumetric):
    """The outer surface shrinks (or grows) by 1.2 mm and turns by 25 degrees; both ends slide in their planes."""
    points, cells, radius, height = tube()
    profile, stress = pressed(squeeze, 0.4)
    turn = about_axis(25)
    exact = turn.apply(points * np.column_stack(2 * [profile(radius) / radius] + [np.ones(len(points))]) @ TILT.T)
    points = points @ TILT.T
    outer, inner = radius > OUTSIDE - 1e-9, radius < INSIDE + 1e-9
    ends = (height == 0) | (height == LENGTH)
    prescribed_nodes = np.flatnonzero(outer | (inner & ends))  # a node slides on one surface, so the inner rims do not
    at_rest = RigidMotion().fraction
    sets = [SlidingSet(np.flatnonzero(inner & ~ends), *cylinder(), about_axis(-30, 3.0).fraction)]
    for z in (0, LENGTH):
        face = np.flatnonzero((height == z) & ~inner & ~outer)
        sets.append(SlidingSet(face, *plane(TILT[:, 2], z * TILT[:, 2], half=60.0, step=3.0), at_rest))
    shrunk = exact @ turn.rotation - points  # about the origin: undoes the turn

    def prescribed(fraction):
        start = points[prescribed_nodes]
        return turn.fraction(fraction).apply(start + fraction * shrunk[prescribed_nodes]) - start

    result, force = solved(points, cells, BoundaryConditions(prescribed_nodes, prescribed, sets), 0.4, volumetric, 1e-8)
    assert result.iterations <= 8  # without the bend of the cylinder in the tangent each digit costs an iteration
    np.testing.assert_allclose(result.displacement, exact - points, rtol=0, atol=0.03)
    on = inner & ~ends
    normal = (points + result.displacement)[on] @ TILT * [1, 1, 0] @ TILT.T / INSIDE
    across = (force[on] * normal).sum(axis=1)
    share = on.sum() / (on.sum() + (inner & ends).sum() / 2)  # of the surface; a node of a rim has half a node's area
    assert across.sum() == pytest.approx(-stress * 2 * np.pi * INSIDE * LENGTH * share, rel=0.012)
    assert np.abs(force[on] - across[:, None] * normal).max() < 1e-4 * np.abs(across).max()
