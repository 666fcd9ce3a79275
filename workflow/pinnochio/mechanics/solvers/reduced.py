"""The part of a mesh that a plan moves far: it is solved, and all else follows by linear elasticity."""

from dataclasses import replace

import numpy as np

from pinnochio.mechanics.boundary.conditions import BoundaryConditions


def moved_cells(cells, field, limit: float, kept=()) -> np.ndarray:
    """Cells (m,) bool of (m, 4) with a node that the linear field (n, 3) mm moves by more than `limit` mm, or with one
    of the nodes `kept`."""
    moved = np.linalg.norm(field, axis=1) > limit
    moved[np.asarray(kept, int)] = True
    return moved[cells].any(axis=1)


def restricted(boundary: BoundaryConditions, cells, wanted, field) -> tuple[np.ndarray, np.ndarray, BoundaryConditions]:
    """The problem of the cells `wanted` (m,) bool of (m, 4) alone: its nodes (k,), its cells by their places among
    these, and its boundary condition.

    Nodes on the cut, and of contact surfaces beyond it, move in proportion to the load by their part of the linear
    field (n, 3) mm; those that were prescribed move as they did.
    """
    own = cells[wanted]
    nodes = np.unique(np.concatenate([own.ravel(), *(item.faces.ravel() for item in boundary.contact)]))
    place = np.full(len(field), -1)
    place[nodes] = np.arange(len(nodes))
    cut = np.ones(len(field), bool)
    cut[own] = False
    cut[cells[~wanted]] = True
    cut[boundary.prescribed_nodes] = False
    cut = nodes[cut[nodes]]
    kept = place[boundary.prescribed_nodes] >= 0
    rest = field[cut]

    def prescribed(fraction: float) -> np.ndarray:
        return np.vstack([boundary.displacement(fraction)[kept], fraction * rest])

    slides = np.zeros(len(field), bool)
    slides[nodes] = True
    slides[cut] = False
    return (
        nodes,
        place[own],
        replace(
            boundary,
            prescribed_nodes=place[np.concatenate([boundary.prescribed_nodes[kept], cut])],
            prescribed=prescribed,
            sliding=[replace(item, nodes=place[item.nodes[slides[item.nodes]]]) for item in boundary.sliding],
            contact=[replace(item, nodes=place[item.nodes], faces=place[item.faces]) for item in boundary.contact],
        ),
    )
