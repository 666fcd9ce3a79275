"""Local refinement: longest-edge bisection of a tetrahedral mesh that stays conforming."""

from collections.abc import Callable

import numpy as np

from pinnochio.errors import refusal
from pinnochio.geometry.mesh_topology import EDGES, edges_of
from pinnochio.meshing.lips import near_mouth
from pinnochio.meshing.mesh import TetMesh

PASSES = 200
LONGEST_OVER_MEAN = 1.6  # of the edges of a part bisected to a longest edge [X]


def refine(mesh: TetMesh, size: Callable[[np.ndarray], np.ndarray]) -> TetMesh:
    """The mesh with every edge bisected until none is longer than size(its middle).

    size: wanted edges (k,) in mm at points (k, 3) mm; infinite where any edge will do. Of a cell with an edge that
    is too long the longest is bisected, after those of its neighbours around that edge if theirs are longer (Rivara
    1997); so their neighbours may be bisected too, as few as keep the mesh conforming and its angles bounded.

    The old nodes come first, where they were; new ones are middles of edges, so planes stay planes, and faces that
    share no node stay apart. Cells inherit their tissue. The same input gives the same bytes. Raises InputError for
    sizes that are not positive, or so small that 200 passes do not reach them.
    """
    refuse = refusal("-", "mesh")
    points, cells, tissue = mesh.points, mesh.cells.astype(np.int64), mesh.tissue
    for _ in range(PASSES):
        edges, of_cell = edges_of(cells)
        one, two = points[edges[:, 0]], points[edges[:, 1]]
        length, middle = np.linalg.norm(one - two, axis=1), (one + two) / 2
        wanted = np.asarray(size(middle), float)
        if not (wanted > 0).all():
            refuse(f"wanted edge of {np.min(wanted)} mm", "ask for edges above 0 mm")
        # One order of all edges, by length, then by nodes: every cell has one longest edge, and no two cells disagree.
        rank = np.empty(len(edges), np.int64)
        rank[np.argsort(length, kind="stable")] = np.arange(len(edges))
        longest = np.take_along_axis(of_cell, rank[of_cell].argmax(axis=1)[:, None], axis=1)[:, 0]
        split = _terminal(of_cell, longest, (length > wanted)[of_cell].any(axis=1), len(edges))
        if not split.any():
            return TetMesh(points, cells.astype(np.int32), tissue)
        node = np.full(len(edges), -1)
        node[split] = len(points) + np.arange(split.sum())
        points = np.concatenate([points, middle[split]])
        cells, tissue = _bisected(cells, tissue, of_cell, node)
    refuse(f"edges are too long after {PASSES} passes", "ask for longer edges")


def refine_mouth(mesh: TetMesh, mouth: np.ndarray, edge: float) -> TetMesh:
    """The mesh with edges of `edge` mm in the mean around the middle of the bite, mouth (b, 3) mm; the mesh itself
    without a bite."""
    longest = LONGEST_OVER_MEAN * edge
    return refine(mesh, lambda points: np.where(near_mouth(points, mouth), longest, np.inf))


def _terminal(of_cell, longest, wanting, count: int) -> np.ndarray:
    """Edges (e,) bool to bisect: the longest of all cells around them, reached from the wanting cells (m,).

    From a cell the way leads to all cells around its longest edge, then around theirs. A cell has one longest edge, so
    no two terminal edges share a cell.
    """
    reached = np.zeros(count, bool)
    while not reached[longest[wanting]].all():
        reached[longest[wanting]] = True
        wanting = reached[of_cell].any(axis=1)
    around = np.bincount(of_cell.ravel(), minlength=count)
    return reached & (np.bincount(longest, minlength=count) == around)


def _bisected(cells, tissue, of_cell, node) -> tuple[np.ndarray, np.ndarray]:
    """Cells and tissue after bisecting the edges whose middle has a node (e,), else -1; at most one of each cell."""
    hit = node[of_cell]
    row, edge = np.nonzero(hit >= 0)
    halves = np.stack([cells, cells], axis=1)
    for side in (0, 1):
        halves[row, side, EDGES[edge, side]] = hit[row, edge]
    # The second half follows the first, so that neighbours in the list stay neighbours in space.
    keep = np.column_stack([np.ones(len(cells), bool), (hit >= 0).any(axis=1)])
    return halves[keep], np.repeat(tissue, keep.sum(axis=1))
