"""Boundary conditions: nodes with a prescribed motion, and nodes that slide along a moving surface."""

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.faces import boundary_faces, edge_graph, edges_of
from pinnochio.geometry.triangles import vertex_areas
from pinnochio.mechanics.contact import ContactSet, facing_sets
from pinnochio.mechanics.loads import Loads
from pinnochio.mechanics.point_surface import PointSurface
from pinnochio.model.labels import CRANIUM, segment_name
from pinnochio.model.patient import FIXED, FREE, LOWER_LIP, MOVING, SLIDING, UPPER_LIP, PatientModel
from pinnochio.plans.plan import Plan, RigidMotion

ARMS = ("bonded", "mucosa", "mucosa+lip")
# Bone further than this from every tissue node of its segment cannot be slid upon. Above the largest motion, mm [I].
REACH = 25.0
# Bonded, jaws that are nearer to each other than this along the tissue leave it free between them, mm: as far as a jaw
# is ever moved [R], tissue could not follow both. With 6, 8 or 10 single patients' elements turn inside out [X].
APART = 14.0


@dataclass(frozen=True)
class SlidingSet:
    """Nodes (s,) that keep their signed distance to a rigidly moving surface and are free along it.

    points, normals (b, 3): the surface at rest, normals outward; motion(fraction) is where it has moved to.
    """

    nodes: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    motion: Callable[[float], RigidMotion]


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


class SlidingContact:
    """The sliding sets of one mesh: holds their nodes on the level sets of their surfaces where they started."""

    def __init__(self, points, sets):
        self.points = np.asarray(points, float)
        self.sets = [item for item in sets if len(item.nodes)]
        self.nodes = np.concatenate([np.zeros(0, int)] + [np.asarray(item.nodes, int) for item in self.sets])
        self.surfaces = [PointSurface(item.points, item.normals) for item in self.sets]
        self._levels = [
            surface.distance(self.points[item.nodes])[0] for surface, item in zip(self.surfaces, self.sets, strict=True)
        ]

    def under(self, sets) -> "SlidingContact":
        """The same nodes on the same surfaces in another motion."""
        other = copy.copy(self)
        other.sets = [replace(item, motion=cache(item.motion)) for item in sets if len(item.nodes)]
        return other

    def carry(self, displacement, start: float, end: float) -> np.ndarray:
        """Displacement (n, 3) with the sliding nodes carried by their surfaces from fraction `start` to `end`."""
        moved = np.array(displacement, float)
        for item in self.sets:
            rest, here = self.points[item.nodes], item.motion(start).inverse(self._place(item, moved))
            moved[item.nodes] = item.motion(end).apply(here) - rest
        return moved

    def project(self, displacement, fraction: float) -> np.ndarray:
        """Displacement (n, 3) with the sliding nodes put back on their level sets at `fraction`."""
        moved = np.array(displacement, float)
        for item, surface, level in zip(self.sets, self.surfaces, self._levels, strict=True):
            motion = item.motion(fraction)
            here = surface.project(motion.inverse(self._place(item, moved)), level)
            moved[item.nodes] = motion.apply(here) - self.points[item.nodes]
        return moved

    def frames(self, displacement, fraction: float) -> np.ndarray:
        """Local axes (s, 3, 3) of the sliding nodes, in rows: normal of the moved surface and two tangents."""
        normals = [np.zeros((0, 3))]
        for item, surface in zip(self.sets, self.surfaces, strict=True):
            motion = item.motion(fraction)
            _, gradient = surface.distance(motion.inverse(self._place(item, displacement)))
            normals.append(gradient @ motion.rotation.T)
        return _frames(np.vstack(normals))

    def curvature(self, displacement, fraction: float, frames, force) -> np.ndarray:
        """What the bend of the surfaces adds to the tangent, (s, 3, 3) in mN/mm in local axes, zero along the first.

        The Hessian of the energy on a level set of g is K - (force . grad g / |grad g|^2) d2g along it; force (n, 3) in
        mN is the gradient of the energy. d2g is taken by central differences of the gradient.
        """
        step, blocks, done = 1e-3, [np.zeros((0, 3, 3))], 0
        for item, surface in zip(self.sets, self.surfaces, strict=True):
            motion, axes = item.motion(fraction), frames[done : done + len(item.nodes)]
            done += len(item.nodes)
            here = motion.inverse(self._place(item, displacement))
            pull, local = force[item.nodes] @ motion.rotation, axes @ motion.rotation
            gradient = surface.distance(here)[1]
            reaction = (pull * gradient).sum(axis=1) / np.maximum((gradient**2).sum(axis=1), 1e-12)
            columns = []
            for tangent in (local[:, 1], local[:, 2]):
                change = surface.distance(here + step * tangent)[1] - surface.distance(here - step * tangent)[1]
                columns.append(np.einsum("sij,sj->si", local[:, 1:], change / (2 * step)))
            bend = np.zeros((len(item.nodes), 3, 3))
            bend[:, 1:, 1:] = np.stack(columns, axis=2)
            blocks.append(-reaction[:, None, None] * (bend + bend.transpose(0, 2, 1)) / 2)
        return np.concatenate(blocks)

    def violation(self, displacement, fraction: float = 1.0) -> np.ndarray:
        """Signed gap (s,) in mm that opened (positive) or closed (penetration, negative) at the sliding nodes."""
        gaps = [np.zeros(0)]
        for item, surface, level in zip(self.sets, self.surfaces, self._levels, strict=True):
            here = item.motion(fraction).inverse(self._place(item, displacement))
            gaps.append(surface.distance(here)[0] - level)
        return np.concatenate(gaps)

    def _place(self, item: SlidingSet, displacement) -> np.ndarray:
        return self.points[item.nodes] + displacement[item.nodes]


def _frames(normals) -> np.ndarray:
    """Right-handed orthonormal axes (s, 3, 3), the first along each normal (s, 3)."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-12, normals / np.maximum(length, 1e-12), [1.0, 0, 0])
    other = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    tangent = np.cross(normals, other)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack([normals, tangent, np.cross(normals, tangent)], axis=1)


def boundary_conditions(model: PatientModel, plan: Plan, arm: str, unilateral: bool = False) -> BoundaryConditions:
    """Boundary conditions of a plan. Fixed nodes stay, moving nodes follow their segment; sliding nodes follow it in
    the arm "bonded" (free where a mesh edge, or a way along edges shorter than APART, ties them to the other jaw,
    because the tissue between could not follow both) and slide along the moved bone, their distance to it kept, in the
    arm "mucosa" [S: KIM16/17]; unilateral, they may leave it.
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
            own = segment == index
            moved[own] = motion.fraction(fraction).displacement(rest[own])
        return moved

    sliding, contact = [], []
    if unilateral or arm == "mucosa+lip":
        faces, _ = boundary_faces(model.cells)
    if arm != "bonded":
        slides = model.node_type == SLIDING
        for index in np.unique(model.node_segment[slides]):
            motion = RigidMotion() if index < 0 else plan.motion(model.segments[index])
            points, normals = _facing_bone(model, index)
            own = np.flatnonzero(slides & (model.node_segment == index))
            if unilateral:
                areas = vertex_areas(model.points, faces)[own]
                contact.append(
                    ContactSet(own, areas, points=points, normals=normals, motion=motion.fraction, touching=True)
                )
            else:
                sliding.append(SlidingSet(own, points, normals, motion.fraction))
    if arm == "mucosa+lip":
        upper, lower = (np.flatnonzero(model.lip == lip) for lip in (UPPER_LIP, LOWER_LIP))
        contact += facing_sets(model.points, faces, upper, lower, model.node_type != FREE)
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
    for own in np.unique(body[body > -2]):
        away = dijkstra(graph, False, np.flatnonzero(body == own), limit=APART, min_only=True)
        bridging |= np.isfinite(away) & (body > -2) & (body != own)
    return bridging


def _facing_bone(model: PatientModel, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Bone of a segment that faces its tissue: without the far side of thin plates, whose normals would cancel."""
    tissue = np.flatnonzero((model.node_segment == index) & np.isin(model.node_type, (MOVING, SLIDING)))
    own = model.bone_segment == index
    points, normals = model.bone_points[own], model.bone_normals[own]
    if len(points) < 4:
        name = segment_name(index, model.segments)
        raise InputError("-", "model", f"sliding nodes on segment {name!r}, which has no surface", "rebuild the model")
    away, nearest = cKDTree(model.points[tissue]).query(points)
    outward = model.node_normal[tissue[nearest]]
    keep = (away < REACH) & (np.einsum("bi,bi->b", normals, outward) < 0.3)
    keep &= np.linalg.norm(normals, axis=1) > 0.5
    return points[keep], normals[keep]
