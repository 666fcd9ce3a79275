"""Boxes of tetrahedra and the block problem: what elements and solvers are compared on."""

from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.materials import Material, lame

BLOCK = (80.0, 60.0, 30.0)  # mm


def box(size, steps, jitter=0.0, seed=0) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) mm and cells (m, 4) of a box [0, size] cut into steps (3,) cubes of six tetrahedra.

    jitter: largest move of an interior node, in cube edges.
    """
    axes = [np.linspace(0, s, n + 1) for s, n in zip(size, steps, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(points)).reshape([n + 1 for n in steps])
    corner, stride = index[:-1, :-1, :-1].ravel(), np.array(index.strides) // index.itemsize
    cells = []
    for order in permutations(range(3)):
        path = np.cumsum([0] + [stride[axis] for axis in order])
        if np.linalg.det(np.eye(3)[list(order)]) < 0:
            path = path[[0, 2, 1, 3]]
        cells.append(corner[:, None] + path)
    inside = ((points > 0) & (points < np.array(size))).all(axis=1)
    moves = np.random.default_rng(seed).uniform(-jitter, jitter, points.shape)
    points[inside] += (moves * np.array(size) / np.array(steps))[inside]
    return points, np.stack(cells, axis=1).reshape(-1, 4).astype(np.int32)


def uniform(count, poisson=0.49, stiffening=0.0, youngs_modulus=5.0) -> Material:
    """One material for `count` elements; kPa."""
    mu, lam = lame(youngs_modulus, poisson)
    return Material(np.full(count, mu), np.full(count, lam), np.full(count, float(stiffening)))


def block_boundary(points, shear: bool = False) -> BoundaryConditions:
    """The bottom's left third is fixed; its right third is lifted by 8 mm and turned by 5 degrees about its middle.

    shear: instead, moved along the block by 8 mm and turned by -5 degrees about the block's corner, which plain
    tetrahedra follow far worse. points (n, 3) mm of a box of size BLOCK; the motion grows in proportion to the load.
    """
    x, bottom = points[:, 0], points[:, 2] == 0
    nodes = np.flatnonzero(bottom & ((x < BLOCK[0] / 3 + 1e-9) | (x > 2 * BLOCK[0] / 3 - 1e-9)))
    rest = points[nodes]
    right = rest[:, :1] > BLOCK[0] / 2
    centre = np.zeros(3) if shear else np.array([BLOCK[0] * 5 / 6, BLOCK[1] / 2, 0])
    way = np.array([8.0, 0, 0]) if shear else np.array([0, 0, 8.0])
    turn = np.deg2rad([0, -5.0 if shear else 5.0, 0])

    def prescribed(fraction: float) -> np.ndarray:
        turned = Rotation.from_rotvec(fraction * turn).apply(rest - centre) + centre
        return np.where(right, turned + fraction * way - rest, 0.0)

    return BoundaryConditions(nodes, prescribed)
