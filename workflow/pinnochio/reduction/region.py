"""The part of a mesh that a plan moves far: it is solved, and all else follows by linear elasticity."""

from dataclasses import replace

import numpy as np

from pinnochio.mechanics.sliding import BoundaryConditions, SlidingSet


def moved_cells(cells, field, limit: float, kept=()) -> np.ndarray:
    """Cells (m,) bool of (m, 4) with a node that the linear field (n, 3) mm moves by more than `limit` mm, or with one
    of the nodes `kept`."""
    moved = np.linalg.norm(field, axis=1) > limit
    moved[np.asarray(kept, int)] = True
    return moved[cells].any(axis=1)


def restricted(boundary: BoundaryConditions, cells, wanted, field) -> BoundaryConditions:
    """The boundary condition of the cells `wanted` (m,) bool alone: every other node, and those on the cut, moves in
    proportion to the load by its part of the linear field (n, 3) mm. Nodes that were prescribed move as they did.

    The mesh keeps its nodes, so that a solution is one of the whole patient. Contact sets have to lie inside.
    """
    outside = np.ones(len(field), bool)
    outside[cells[wanted]] = False
    outside[cells[~wanted]] = True
    outside[boundary.prescribed_nodes] = False
    held = np.flatnonzero(outside)
    nodes, rest = np.concatenate([boundary.prescribed_nodes, held]), field[held]

    def prescribed(fraction: float) -> np.ndarray:
        return np.vstack([boundary.displacement(fraction), fraction * rest])

    sliding = [_without(item, outside) for item in boundary.sliding]
    return replace(boundary, prescribed_nodes=nodes, prescribed=prescribed, sliding=sliding)


def _without(item: SlidingSet, outside) -> SlidingSet:
    return replace(item, nodes=np.asarray(item.nodes, int)[~outside[item.nodes]])
