"""Moving mesh nodes without spoiling a single tetrahedron."""

import numpy as np
from scipy import sparse

from pinnochio.meshing.mesh import dihedral_cosines, volumes

HALVINGS = 5


def acceptable(points, cells, minimum_dihedral: float) -> np.ndarray:
    """Which cells (m,) have positive volume and every dihedral angle at or above the minimum, degrees."""
    good = dihedral_cosines(points, cells).max(axis=1) <= np.cos(np.radians(minimum_dihedral))
    return good & (volumes(points, cells) > 0)


def acceptable_move(points, target, cells, minimum_dihedral: float) -> np.ndarray:
    """Points moved toward `target` as far as every cell stays acceptable.

    A node of a cell that the move would spoil goes half as far, and so on; after five halvings it stays. Cells that
    are acceptable at `points` are acceptable at the result.
    """
    step = target - points
    fraction = np.where(np.abs(step).max(axis=1) > 0, 1.0, 0.0)
    halved = np.zeros(len(points), int)
    moved = points + step
    changed = fraction > 0
    while changed.any():
        near = cells[changed[cells].any(axis=1)]  # only around nodes that went less far
        changed[:] = False
        changed[near[~acceptable(moved, near, minimum_dihedral)]] = True
        changed &= fraction > 0
        nodes = np.flatnonzero(changed)
        halved[nodes] += 1
        fraction[nodes] = np.where(halved[nodes] > HALVINGS, 0, fraction[nodes] / 2)
        moved[nodes] = points[nodes] + fraction[nodes, None] * step[nodes]
    return moved


def neighbour_mean(points, pairs) -> np.ndarray:
    """Mean (n, 3) of the neighbours of every node over undirected edges (e, 2); the node itself where it has none."""
    count = len(points)
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = sparse.csr_array((np.ones(len(i)), (i, j)), shape=(count, count))
    graph.data[:] = 1
    degree = np.diff(graph.indptr)
    return np.where(degree[:, None] > 0, graph @ points / np.maximum(degree, 1)[:, None], points)
