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
    # Node to cells, to look again only at the cells around a node that went less far.
    around = sparse.csr_array(
        (np.ones(cells.size, np.int8), (cells.ravel(), np.repeat(np.arange(len(cells)), 4))),
        shape=(len(points), len(cells)),
    )
    fraction = np.where(np.abs(step).max(axis=1) > 0, 1.0, 0.0)
    halved = np.zeros(len(points), int)
    moved = points + step
    watch = np.flatnonzero(fraction[cells].any(axis=1))
    while len(watch):
        bad = watch[~acceptable(moved, cells[watch], minimum_dihedral)]
        nodes = np.unique(cells[bad])
        nodes = nodes[fraction[nodes] > 0]
        if len(nodes) == 0:
            break
        halved[nodes] += 1
        fraction[nodes] = np.where(halved[nodes] > HALVINGS, 0, fraction[nodes] / 2)
        moved[nodes] = points[nodes] + fraction[nodes, None] * step[nodes]
        watch = np.unique(around[nodes].indices)
    return moved


def neighbour_mean(points, pairs, weight=None) -> np.ndarray:
    """Mean (n, 3) of the neighbours of every node over undirected edges (e, 2); the node itself where it has none."""
    count = len(points)
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = sparse.csr_array((np.ones(len(i)), (i, j)), shape=(count, count))
    graph.data[:] = 1
    degree = np.diff(graph.indptr)
    return np.where(degree[:, None] > 0, graph @ points / np.maximum(degree, 1)[:, None], points)
