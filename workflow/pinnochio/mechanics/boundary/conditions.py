"""Boundary conditions of a plan: which nodes are fixed, move with bone, slide on it or bear on each other."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse.csgraph import dijkstra

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import boundary_faces, edge_graph, edges_of
from pinnochio.mechanics.boundary.contact import ContactSet
from pinnochio.mechanics.boundary.lips import facing_sets
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.boundary.sliding import SlidingSet, sliding_sets
from pinnochio.model.labels import CRANIUM, segment_name
from pinnochio.model.patient import FIXED, FREE, LOWER_LIP, MOVING, SLIDING, UPPER_LIP, PatientModel
from pinnochio.plans.plan import Plan

ARMS = ("bonded", "mucosa", "mucosa+lip")
# Bonded, jaws that are nearer to each other than this along the tissue leave it free between them, mm: as far as a jaw
# is ever moved [R], tissue could not follow both. With 6, 8 or 10 single patients' elements turn inside out [X].
APART = 14.0


@dataclass(frozen=True)
class BoundaryConditions:
    """What a solution is asked for: prescribed nodes, sliding sets and contact sets; a node is in one of them at most.

    prescribed: displacement (p, 3) in mm at the end, applied in proportion, or a function of the fraction in [0, 1].
    loads: forces beside those of the elements.
    """

    prescribed_nodes: np.ndarray
    prescribed: np.ndarray | Callable[[float], np.ndarray]
    sliding: list[SlidingSet] = field(default_factory=list)
    contact: list[ContactSet] = field(default_factory=list)
    loads: Loads | None = None

    def displacement(self, fraction: float) -> np.ndarray:
        """Displacement (p, 3) in mm of the prescribed nodes at a fraction of the load."""
        moved = self.prescribed(fraction) if callable(self.prescribed) else fraction * np.asarray(self.prescribed)
        return np.asarray(moved, float)


def boundary_conditions(model: PatientModel, plan: Plan, arm: str) -> BoundaryConditions:
    """Boundary conditions of a plan. Fixed nodes stay, moving nodes follow their segment; sliding nodes follow it in
    the arm "bonded" (free where a mesh edge, or a way along edges shorter than APART, ties them to the other jaw,
    because the tissue between could not follow both) and slide along the moved bone, their distance to it kept, in the
    arm "mucosa" [S: KIM16/17].
    In the arm "mucosa+lip" the lips, too, touch without entering each other; without lips it is "mucosa"."""
    if arm not in ARMS:
        raise InputError(plan.case, "options", f"arm is {arm!r}", f"choose one of {ARMS}")
    unknown = sorted(set(plan.motions) - set(model.segments))
    if unknown:
        raise InputError(plan.case, "plan", f"the patient has no segment {unknown}", f"name one of {model.segments}")
    constrained = np.isin(model.node_type, (FIXED, MOVING))
    if arm == "bonded":
        constrained |= (model.node_type == SLIDING) & ~_bridging(model)
    nodes = np.flatnonzero(constrained)
    rest, segment = model.points[nodes], np.where(model.node_type == FIXED, -1, model.node_segment)[nodes]
    motions = {index: plan.motion(segment_name(index, model.segments)) for index in np.unique(segment) if index >= 0}

    def prescribed(fraction: float) -> np.ndarray:
        moved = np.zeros_like(rest)
        for index, motion in motions.items():
            carried = segment == index
            moved[carried] = motion.fraction(fraction).displacement(rest[carried])
        return moved

    sliding, contact = [], []
    if arm != "bonded":
        sliding = sliding_sets(model, plan)
    if arm == "mucosa+lip":
        faces, _ = boundary_faces(model.cells)
        upper, lower = (np.flatnonzero(model.lip == lip) for lip in (UPPER_LIP, LOWER_LIP))
        contact = facing_sets(model.points, faces, upper, lower, model.node_type != FREE)
    return BoundaryConditions(nodes, prescribed, sliding, contact)


def _bridging(model: PatientModel) -> np.ndarray:
    """Nodes (n,) bool at an end of a mesh edge from one bone to another, or of a way along mesh edges shorter than
    APART: bonded, the tissue between could not follow both."""
    body = np.where(np.isin(model.node_type, (MOVING, SLIDING)), model.node_segment, -2)
    body = np.where((model.node_type == FIXED) & (model.node_beyond == CRANIUM), -1, body)
    edges, _ = edges_of(model.cells)
    one, two = body[edges].T
    bridging = np.zeros(len(body), bool)
    bridging[edges[(one != two) & (one > -2) & (two > -2)]] = True
    graph = edge_graph(model.points, edges)
    for bone in np.unique(body[body > -2]):
        away = dijkstra(graph, False, np.flatnonzero(body == bone), limit=APART, min_only=True)
        bridging |= np.isfinite(away) & (body > -2) & (body != bone)
    return bridging
