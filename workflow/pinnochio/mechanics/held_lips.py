"""Lips as people hold them, for what is shown: they bear on each other, and close where they were closed before.

No method but one models how lips touch, and none the muscle that closes them. What is judged stays as it is predicted.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.labels import TISSUES
from pinnochio.model.patient import LOWER_LIP, UPPER_LIP, PatientModel
from pinnochio.plans.plan import Plan

NEAR = 5.0  # mm within which lips meet [I]
BESIDE = 4.0  # mm to both sides of a node in which the lips' edges are looked for [I]
SEALED = 2.0  # mm between the edges of lips that a mesh shows as closed [X]
CLOSING = 4.0  # mm by which muscle brings lips together that surgery parts [I]
ROUNDS = 4
CROSSED, OPEN = 0.3, 2.0  # mm that lips cross, and are apart, from which it is said [I]
POISSON = 0.45  # of tissue that is soft alike everywhere: how stiff it is does not count where lips are moved [I]


@dataclass(frozen=True)
class HeldLips:
    """displacement (n, 3) mm of the nodes with lips in contact, and closed if that was asked for.

    crossed: how far the lips crossed beyond what they did before; before, parted, left: how far their edges lie apart
    before surgery, as predicted and as shown, at most of where they face each other; all mm, 0 without a mouth slit.
    """

    displacement: np.ndarray
    crossed: float = 0.0
    before: float = 0.0
    parted: float = 0.0
    left: float = 0.0


def held_lips(patient: PatientModel, displacement: np.ndarray, closing: float = CLOSING) -> HeldLips:
    """A field (n, 3) mm whose lips bear on each other; edges no farther than SEALED apart before surgery that it parts
    come together again, by `closing` mm at most. Vertical forces on the lips' nodes do it, spread by linear elasticity
    with sliding interfaces: none that draws lips together that cross, none that presses apart what gapes."""
    nodes = [np.flatnonzero(patient.lip == lip) for lip in (UPPER_LIP, LOWER_LIP)]
    moved = np.array(displacement, float)
    if not all(map(len, nodes)):
        return HeldLips(moved)
    lips, upper = np.concatenate(nodes), len(nodes[0])
    rest, forces = patient.points[lips], np.zeros(len(lips))
    before, shown = np.maximum(_overlaps(rest, upper)[1], 0), rest + moved[lips]
    sealed, start = _gaps(rest, upper)[1], _gaps(shown, upper)[1]
    wanted = np.maximum(np.maximum(sealed, 0), start - closing)
    depth = _overlaps(shown, upper)[1] - before
    crossed = max(0.0, float(depth.max()))
    for _ in range(ROUNDS):
        (over, depth), (across, gap) = _overlaps(shown, upper), _gaps(shown, upper)
        part = (gap > wanted) & (sealed <= SEALED) & (closing > 0)
        rows = np.vstack([over[depth > before], across[part]])
        if not len(rows):
            break
        fields = _response(patient)
        lengths = np.concatenate([(depth - before)[depth > before], (gap - wanted)[part]])
        work = rows @ fields[:, lips, 2] @ rows.T
        work += 1e-3 * np.trace(work) / len(work) * np.eye(len(work))  # neighbours may ask for the same
        forces -= rows.T @ nnls(work, lengths)[0]
        moved = displacement + np.tensordot(forces, fields, 1)
        shown = rest + moved[lips]
    ends = [max(0.0, float(each.max())) for each in (sealed, start, _gaps(shown, upper)[1])]
    return HeldLips(moved, crossed, *ends)


def shown_skin(patient: PatientModel, displacement: np.ndarray, closing: float = 0.0) -> np.ndarray:
    """Points (s, 3) mm of the skin under a field (n, 3) mm, with lips in contact, closed by `closing` mm at most."""
    return patient.moved_skin(held_lips(patient, displacement, closing).displacement)


@lru_cache(maxsize=1)
def _response(patient: PatientModel) -> np.ndarray:
    """Fields (l, n, 3) under a force upwards on each node of the lips, upper ones first, of tissue of 1 kPa."""
    law = neo_hookean(patient.tissue, dict.fromkeys(TISSUES.values(), 1.0), POISSON)
    boundary = boundary_conditions(patient, Plan("rest", {}), "mucosa")
    solver = ElasticSolver(patient.points, patient.cells, law, boundary, single=True)
    lips = np.concatenate([np.flatnonzero(patient.lip == lip) for lip in (UPPER_LIP, LOWER_LIP)])
    fields = np.zeros((len(lips), *patient.points.shape), np.float32)
    for field, node in zip(fields, lips, strict=True):
        load = np.zeros((1, *patient.points.shape))
        load[0, node, 2] = 1.0
        field[:] = solver.under(load)[0]
    solver.close()
    return fields


def _overlaps(points: np.ndarray, upper: int) -> tuple[np.ndarray, np.ndarray]:
    """How far (l,) mm each node (l, 3) of the lips lies beyond the other one, after rows (l, l) that read it."""
    rows, ones = np.zeros((len(points), len(points))), np.arange(len(points))
    for lip, other, down in ((ones[:upper], ones[upper:], -1.0), (ones[upper:], ones[:upper], 1.0)):
        away, near = cKDTree(points[other, :2]).query(points[lip, :2], k=min(3, len(other)), distance_upper_bound=NEAR)
        away, near = away.reshape(len(lip), -1), near.reshape(len(lip), -1)
        weights = np.where(np.isfinite(away), 1 / (away + 0.1), 0)
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
        np.add.at(rows, (lip[:, None], other[np.minimum(near, len(other) - 1)]), -down * weights)
        rows[lip, lip] += down * weights.any(axis=1)
    return rows, rows @ points[:, 2]


def _gaps(points: np.ndarray, upper: int) -> tuple[np.ndarray, np.ndarray]:
    """How far (l,) mm the edges of the lips lie apart beside each node (l, 3), -inf where one has none, after rows
    (l, l) that read it of heights: from the highest node of the lower lip to the lowest of the upper one."""
    rows, gaps = np.zeros((len(points), len(points))), np.full(len(points), -np.inf)
    beside = np.abs(points[:, :1] - points[:, 0]) < BESIDE
    for row, near in enumerate(beside):
        above, below = np.flatnonzero(near[:upper]), upper + np.flatnonzero(near[upper:])
        if len(above) and len(below):
            ends = below[points[below, 2].argmax()], above[points[above, 2].argmin()]
            rows[row, ends] = -1.0, 1.0
            gaps[row] = points[ends[1], 2] - points[ends[0], 2]
    return rows, gaps
