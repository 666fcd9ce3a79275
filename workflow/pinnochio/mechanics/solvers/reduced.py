"""The part of a mesh that a plan moves far: it is solved, and all else follows by linear elasticity."""

from dataclasses import replace

import numpy as np

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import known_role

# Largest share of the cells that is solved alone: more pays little for factors of its own, and with both jaws moving
# far the linear field errs by tenths of millimetres where the cut would be [X: docs/explanation/scene.md].
WORTH = 0.5


def pays(required: np.ndarray) -> bool:
    """Whether to solve the cells (m,) bool alone."""
    return 0 < required.mean() <= WORTH


def moves_widely(patient: PatientModel, plan: Plan, limit: float) -> bool:
    """Whether bones of several roles move by more than `limit` mm, as the parts of a lower jaw do, or both jaws: most
    cells then move, too many to make a linear map for [X]."""
    length = np.linalg.norm(patient.bone_displacement(plan), axis=1)
    moved = np.unique(patient.bone_segment[length > limit])
    return len({known_role(patient.segments[index]) for index in moved}) > 1


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
    part = cells[wanted]
    nodes = np.unique(np.concatenate([part.ravel(), *(item.faces.ravel() for item in boundary.contact)]))
    place = np.full(len(field), -1)
    place[nodes] = np.arange(len(nodes))
    cut = np.ones(len(field), bool)
    cut[part] = False
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
        place[part],
        replace(
            boundary,
            prescribed_nodes=place[np.concatenate([boundary.prescribed_nodes[kept], cut])],
            prescribed=prescribed,
            sliding=[replace(item, nodes=place[item.nodes[slides[item.nodes]]]) for item in boundary.sliding],
            contact=[replace(item, nodes=place[item.nodes], faces=place[item.faces]) for item in boundary.contact],
        ),
    )
