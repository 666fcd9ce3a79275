"""Nested dissection of a mesh: a binary tree of separators, whose fronts can be eliminated level by level.

A part is halved across its longest extent; of the edges that are cut, a least set of nodes that meets all of them is
the separator (a vertex cover, from a largest matching by the theorem of Koenig). [S: George 1973]
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, maximum_bipartite_matching

LEAF = 48  # nodes in a part that is not halved further, about [X]


@dataclass(frozen=True)
class FrontLevel:
    """Fronts of one depth of the tree. pivots (f, s): nodes that each eliminates, beside (f, b): later ones that it is
    coupled to, -1 where there are fewer; children: numbers (f, 2) of the fronts one level deeper that it takes up, -1
    at the leaves."""

    pivots: np.ndarray
    beside: np.ndarray
    children: np.ndarray


def dissect(points, adjacency: sparse.csr_array, leaf: int = LEAF) -> list[FrontLevel]:
    """The levels of the tree, leaves first, over points (n, 3) mm with a symmetric adjacency (n, n)."""
    depth = max(int(np.ceil(np.log2(max(len(points), 1) / leaf))), 0)
    parts, owners = [np.arange(len(points))], []
    for _ in range(depth):
        halves = [_halved(points, adjacency, part) for part in parts]
        owners.append([separator for separator, _, _ in halves])
        parts = [part for _, *both in halves for part in both]
    owners.append(parts)
    rank = np.empty(len(points), int)
    for level, owned in enumerate(owners):
        rank[np.concatenate(owned)] = level
    levels, below = [], []
    for level in range(depth, -1, -1):
        beside = []
        for number, pivots in enumerate(owners[level]):
            reached = [adjacency[pivots].indices, *(below[2 * number : 2 * number + 2])]
            reached = np.unique(np.concatenate(reached))
            beside.append(np.setdiff1d(reached[rank[reached] < level], pivots, assume_unique=True))
        children = np.full((len(beside), 2), -1)
        if below:
            children = np.arange(2 * len(beside)).reshape(-1, 2)
        levels.append(FrontLevel(padded(owners[level]), padded(beside), children))
        below = beside
    return levels


def padded(lists) -> np.ndarray:
    """Integers of several lists as rows, -1 where a list is shorter than the longest."""
    rows = np.full((len(lists), max(map(len, lists))), -1)
    for row, items in zip(rows, lists, strict=True):
        row[: len(items)] = items
    return rows


def _halved(points, adjacency, part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Separator of a part and the two sides that it leaves."""
    if len(part) < 2:
        return part[:0], part, part[:0]
    around = points[part] - points[part].mean(axis=0)
    along = around @ np.linalg.eigh(around.T @ around)[1][:, -1]
    right = np.zeros(len(part), bool)
    right[np.argsort(along, kind="stable")[len(part) // 2 :]] = True
    graph = adjacency[part][:, part]
    cut = graph[~right][:, right].tocsr()
    left_cover, right_cover = _cover(cut)
    apart = np.zeros(len(part), bool)
    apart[np.flatnonzero(~right)[left_cover]] = True
    apart[np.flatnonzero(right)[right_cover]] = True
    return part[apart], part[~right & ~apart], part[right & ~apart]


def _cover(cut: sparse.csr_array) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns, bool, of a least set that meets every entry of a matrix."""
    rows, columns = cut.shape
    matched = maximum_bipartite_matching(cut, perm_type="column")
    # Alternating paths from rows without a partner: along any entry to a column, along the matching to a row.
    pairs = np.flatnonzero(matched >= 0)
    back = sparse.coo_array((np.ones(len(pairs)), (matched[pairs], pairs)), (columns, rows))
    free = np.flatnonzero(matched < 0)
    start = sparse.coo_array((np.ones(len(free)), (np.zeros(len(free), int), free)), (1, rows))
    ways = sparse.block_array([[None, cut, None], [back, None, None], [start, None, sparse.csr_array((1, 1))]]).tocsr()
    reached = np.zeros(rows + columns + 1, bool)
    reached[breadth_first_order(ways, rows + columns, return_predecessors=False)] = True
    return ~reached[:rows], reached[rows : rows + columns]
