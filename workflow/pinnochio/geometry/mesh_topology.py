"""Edges and faces of tetrahedra: which two cells share a face, and which faces belong to the boundary."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

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


def faces_of(cells) -> tuple[np.ndarray, np.ndarray]:
    """All faces (4m, 3), outward, and a key (4m,) that the two sides of a face share."""
    faces = np.asarray(cells)[:, FACES].reshape(-1, 3)
    low, middle, high = np.sort(faces.astype(np.int64), axis=1).T
    count = int(faces.max()) + 1 if len(faces) else 1
    # Two face ids fit 64 bits up to two million nodes.
    return faces, (low * count + middle) * count + high


def adjacency(cells) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of faces that are the two sides of one: indices (p,), (p,) into the 4m faces (cell = index // 4)."""
    _, key = faces_of(cells)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    return order[same], order[same + 1]


def boundary_faces(cells) -> tuple[np.ndarray, np.ndarray]:
    """Outward faces (f, 3) with one cell only, and that cell (f,)."""
    faces, _ = faces_of(cells)
    alone = np.ones(len(faces), bool)
    for side in adjacency(cells):
        alone[side] = False
    index = np.flatnonzero(alone)
    return faces[index], index // 4
