"""Opening voids that are thinner than the lattice (the slit between the lips) by duplicating nodes."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from pinnochio.compiled import compiled
from pinnochio.geometry.mesh_topology import adjacency, boundary_faces, side_nodes
from pinnochio.meshing.fields import Fields
from pinnochio.meshing.mesh import volumes

OPEN_SHARE = 0.4  # of the tissue on a face that must join its two cells
VOID_SHARE = 0.45  # trilinear share of void that blocks a path; 0.5 would leak through diagonal voxels


def simplex_points(corners: int, order: int) -> np.ndarray:
    """Barycentric coordinates (k, corners) of evenly spread points inside a simplex."""
    grid = np.indices((order + 1,) * corners).reshape(corners, -1).T
    grid = grid[grid.sum(axis=1) == order]
    return (grid + 1 / corners) / (order + 1)


def joined_pairs(points, cells, fields: Fields) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of face sides (index = 4 cell + face) whose two cells hang together through tissue.

    Where void is near, each cell is represented by its deepest point in tissue, and two cells are joined if straight
    paths from one to the other through points of their face stay in tissue.
    """
    first, second = adjacency(cells)
    within = simplex_points(4, 3)
    doubt = fields.sample_cells(fields.narrow, points, cells, within).max(axis=1) > 0
    doubtful = np.flatnonzero(doubt[first // 4] | doubt[second // 4])
    sampled = np.unique(np.concatenate([first[doubtful], second[doubtful]]) // 4)
    best = fields.sample_cells(fields.depth, points, cells[sampled], within).argmax(axis=1)
    anchor = np.full((len(cells), 3), np.nan)
    anchor[sampled] = (within[best, None] @ points[cells[sampled]])[:, 0]
    a, b = first[doubtful] // 4, second[doubtful] // 4
    gates = simplex_points(3, 3) @ points[side_nodes(cells, first[doubtful])]
    in_tissue = fields.sample(fields.void, gates) < VOID_SHARE
    reach = max(np.linalg.norm(anchor[side][:, None] - gates, axis=2).max(initial=0) for side in (a, b))
    steps = 1 + int(reach / (0.4 * fields.spacing.min()))
    clear, needed = np.zeros(len(a), int), OPEN_SHARE * in_tissue.sum(axis=1)
    for gate, passes in zip(gates.swapaxes(0, 1), in_tissue.T, strict=True):
        pair = np.flatnonzero(passes & (clear <= needed))
        for side in (a, b):
            pair = pair[fields.clear(anchor[side[pair]], gate[pair], steps, VOID_SHARE)]
        clear[pair] += 1
    joined = np.ones(len(first), bool)
    joined[doubtful] = clear > needed
    return first[joined], second[joined]


def split_nodes(cells, first, second) -> tuple[np.ndarray, np.ndarray]:
    """Give every node one copy per group of its cells that joined faces hold together.

    Returns the new cells (m, 4) and, for each new node, the old one. Both in the order of the old nodes.
    """
    root = _first_corners(cells, first, second)
    start = np.flatnonzero(root == np.arange(cells.size))
    start = start[np.argsort(cells.ravel()[start], kind="stable")]
    renumber = np.empty(cells.size, np.int64)
    renumber[start] = np.arange(len(start))
    return renumber[root].reshape(-1, 4), cells.ravel()[start]


@compiled
def _first_corners(cells, first, second):
    """The first corner (4m,) of the group of each corner."""
    root = np.arange(cells.size)
    for pair in range(len(first)):
        one, two = first[pair] // 4, second[pair] // 4
        for a in range(4):
            for b in range(4):
                if a != first[pair] % 4 and cells[one, a] == cells[two, b]:
                    p, q = 4 * one + a, 4 * two + b
                    while root[p] != p:
                        p = root[p]
                    while root[q] != q:
                        q = root[q]
                    root[max(p, q)] = min(p, q)
    for corner in range(cells.size):
        root[corner] = root[root[corner]]
    return root


def cut_nodes(cells, first, second) -> np.ndarray:
    """Nodes (k,) that :func:`split_nodes` would copy."""
    return np.flatnonzero(np.bincount(split_nodes(cells, first, second)[1]) > 1)


def pieces(count: int, first, second) -> np.ndarray:
    """Piece (m,) of every cell, by joined faces; 0 is the one with the most cells."""
    graph = sparse.coo_array((np.ones(len(first), np.int8), (first // 4, second // 4)), shape=(count, count))
    _, piece = connected_components(graph, directed=False)
    rank = np.argsort(np.argsort(-np.bincount(piece), kind="stable"), kind="stable")
    return rank[piece]


def crowded_cells(points, cells) -> np.ndarray:
    """Cells (k,) to drop so that no edge has over two boundary faces: all but the largest fan around such edges."""
    faces, _ = boundary_faces(cells)
    count = int(cells.max()) + 1
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1) @ np.array([count, 1])
    edges, uses = np.unique(edges, return_counts=True)
    crowded = edges[uses > 2]
    if len(crowded) == 0:
        return np.zeros(0, int)
    touching = np.isin(cells, np.unique(np.stack([crowded // count, crowded % count]))).sum(axis=1) >= 2
    near = np.flatnonzero(touching)
    local = cells[near]
    first, second = adjacency(local)
    size = volumes(points, local)
    drop = []
    for edge in crowded:
        ring = np.flatnonzero(((local == edge // count) | (local == edge % count)).sum(axis=1) == 2)
        inside = np.isin(first // 4, ring) & np.isin(second // 4, ring)
        slot = {cell: i for i, cell in enumerate(ring)}
        links = [(slot[a], slot[b]) for a, b in zip(first[inside] // 4, second[inside] // 4, strict=True)]
        row, column = np.array(links, int).reshape(-1, 2).T
        graph = sparse.coo_array((np.ones(len(row)), (row, column)), shape=(len(ring), len(ring)))
        _, fan = connected_components(graph, directed=False)
        weight = np.bincount(fan, size[ring])
        drop.append(near[ring[fan != weight.argmax()]])
    return np.unique(np.concatenate(drop))
