"""Edges and faces of tetrahedra: which two cells share a face, and which faces belong to the boundary."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from pinnochio.compiled import compiled

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
# Faces of a tetrahedron of positive volume, each seen counter-clockwise from outside; face i is opposite corner i.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


def edges_of(cells) -> tuple[np.ndarray, np.ndarray]:
    """Every edge once, nodes (e, 2) in rising order, sorted; and the six edges (m, 6) of each cell."""
    ends = np.sort(np.asarray(cells, np.int64)[:, EDGES], axis=2)
    count = int(ends.max()) + 1
    key, of_cell = np.unique(ends[..., 0] * count + ends[..., 1], return_inverse=True)
    return np.column_stack(np.divmod(key, count)), of_cell.reshape(-1, 6)


def compacted(cells) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n,) of cells, ascending, and the cells with their numbers among these: `np.unique` without its sorting."""
    there = np.zeros(cells.max(initial=-1) + 1, bool)
    there[cells] = True
    return np.flatnonzero(there), (np.cumsum(there) - 1)[cells]


def edge_graph(points, edges) -> sparse.csr_array:
    """Length (n, n) in mm of every edge (e, 2) between points (n, 3), once."""
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return sparse.csr_array((length, edges.T), (len(points), len(points)))


def pieces(elements, count: int) -> np.ndarray:
    """Connected piece (count,) of each node, connected by triangles or tetrahedra."""
    first = np.repeat(elements[:, 0], elements.shape[1] - 1)
    ends = first, np.asarray(elements)[:, 1:].ravel()
    graph = sparse.coo_array((np.ones(len(first), np.int8), ends), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def side_nodes(cells, sides) -> np.ndarray:
    """Nodes (f, 3), outward, of sides (f,) of cells (side = 4 cell + face)."""
    return np.asarray(cells)[sides[:, None] // 4, FACES[sides % 4]]


def adjacency(cells) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of sides that are those of one face: indices (p,), (p,), in the order of the nodes of the faces."""
    return _paired(np.asarray(cells, np.int64), int(np.max(cells, initial=0)) + 1)


def boundary_faces(cells) -> tuple[np.ndarray, np.ndarray]:
    """Outward faces (f, 3) with one cell only, and that cell (f,)."""
    alone = single_sides(cells, *adjacency(cells))
    return side_nodes(cells, alone), alone // 4


def single_sides(cells, first, second) -> np.ndarray:
    """Sides (f,) that are in none of the pairs of :func:`adjacency`."""
    alone = np.ones(4 * len(cells), bool)
    alone[first] = alone[second] = False
    return np.flatnonzero(alone)


@compiled
def _paired(cells, count):
    # Sides by their lowest node, then, among the few of one, by the others.
    start, sides = np.zeros(count + 1, np.int64), np.empty(cells.size, np.int64)
    lowest, others = np.empty(cells.size, np.int64), np.empty(cells.size, np.int64)
    for side in range(cells.size):
        cell, face = cells[side // 4], side % 4
        a, b, c = cell[face - 3], cell[face - 2], cell[face - 1]
        low, high = min(a, b, c), max(a, b, c)
        lowest[side], others[side] = low, (a + b + c - low - high) * count + high
        start[low + 1] += 1
    start = np.cumsum(start)
    end = start.copy()
    for side in range(cells.size):
        low = lowest[side]
        at = end[low]
        while at > start[low] and others[sides[at - 1]] > others[side]:
            sides[at] = sides[at - 1]
            at -= 1
        sides[at] = side
        end[low] += 1
    first, second, pairs = np.empty(cells.size, np.int64), np.empty(cells.size, np.int64), 0
    for at in range(1, cells.size):
        one, two = sides[at - 1], sides[at]
        if lowest[one] == lowest[two] and others[one] == others[two]:
            first[pairs], second[pairs] = one, two
            pairs += 1
    return first[:pairs], second[:pairs]
