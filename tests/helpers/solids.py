"""Blocks, bodies and surfaces whose every number is known, and what the tests of the mechanics share."""

import numpy as np
import pytest

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.materials import Material, lame
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, Elements
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.plans.plan import RigidMotion
from tests.helpers.settings import fem_settings

both = pytest.mark.parametrize("volumetric", VOLUMETRIC)


def material(count, stiffening=1.5, seed=3):
    """Two tissues at random, nu 0.49."""
    modulus = np.where(np.random.default_rng(seed).random(count) < 0.5, 4.0, 6.0)
    return Material(*lame(modulus, 0.49), np.full(count, float(stiffening)))


def bent_block(steps=(8, 4, 3), move=6.0, degrees=10.0):
    """A 40 x 20 x 15 mm block whose ends are bonded, the right one moved and turned."""
    points, cells = box((40, 20, 15), steps, jitter=0.15)
    ends = np.flatnonzero((points[:, 0] == 0) | (points[:, 0] == 40))
    right = points[ends, 0] == 40
    motion = RigidMotion.from_degrees([0, degrees, 0], [0.5 * move, 0, 0.8 * move], [40, 10, 7])

    def prescribed(fraction):
        moved = np.zeros((len(ends), 3))
        moved[right] = motion.fraction(fraction).displacement(points[ends][right])
        return moved

    return points, cells, BoundaryConditions(ends, prescribed)


def sphere(radius, count):
    """Spiral points and outward normals."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    normals = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return radius * normals, normals


def plane(normal, through, half=40.0, step=2.0):
    """Points and normals of a square patch of a plane."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    first = np.linalg.svd(normal[None])[2][1:]
    grid = np.stack(np.meshgrid(*[np.arange(-half, half + step, step)] * 2), axis=-1).reshape(-1, 2)
    points = through + grid @ first
    return points, np.tile(normal, (len(points), 1))


def solved(points, cells, boundary, poisson=0.49, volumetric=VOLUMETRIC[0], tolerance=1e-6, **options):
    """Result of a converged solution and its internal force (n, 3) in mN; E is 5 kPa throughout."""
    law = uniform(len(cells), poisson)
    # A coarse least increment, so that a wrong tangent fails in seconds.
    options = fem_settings(volumetric=volumetric, tolerance=tolerance, min_increment=1 / 16, **options)
    result = solve(points, cells, law, boundary, options)
    assert result.converged, result.reason
    return result, Elements.build(points, cells, law, volumetric).evaluate(result.displacement)[1]


def extruded(layers, triangles):
    """Points and cells of a body of `layers` (k, t, 3), each triangulated alike by `triangles` (., 3)."""
    count = layers.shape[1]
    # Cut by node number, so that neighbouring prisms agree on the diagonals of their sides.
    a, b, c = np.sort(triangles, axis=1).T
    first = np.array([[a, b, c, c + count], [a, b, b + count, c + count], [a, a + count, b + count, c + count]])
    first = first.transpose(2, 0, 1).reshape(-1, 4)
    cells = (np.arange(len(layers) - 1)[:, None, None] * count + first).reshape(-1, 4)
    points = layers.reshape(-1, 3)
    left_handed = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[left_handed, :2] = cells[left_handed, 1::-1]
    return points, cells
