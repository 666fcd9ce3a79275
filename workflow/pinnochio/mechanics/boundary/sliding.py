"""Sliding: nodes that keep their distance to a bone that moves, and are free along it.

The bone is an implicit surface of its oriented points: a signed distance, positive outside, by moving averages,
Gaussian with the points' own spacing: of the distances to the points' tangent planes (IMLS), which a sphere of radius R
misses by -spacing^2/2R, and of the distances to the points along the mean normal, which misses by as much on the other
side. Half of each is exact on planes and right to third order on curved surfaces. The field is smooth, as Newton's
method needs it: so many points are averaged, however densely they lie where thin bone has two sides, that those left
out weigh less than 1e-5. They are sought among those that are nearest to the node at rest.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.compiled import compiled
from pinnochio.errors import InputError
from pinnochio.model.labels import segment_name
from pinnochio.model.patient import MOVING, SLIDING, PatientModel
from pinnochio.plans.plan import Plan, RigidMotion

# Bone further than this from every tissue node of its segment cannot be slid upon. Above the largest motion, mm [I].
REACH = 25.0
WIDTHS = 3.5  # spacings within which points count; exp(-3.5^2) < 1e-5
NEAREST = 256  # points of the bone that are listed for a node; where they do not reach all points are looked through


@dataclass(frozen=True)
class SlidingSet:
    """Nodes (s,) that keep their signed distance to a rigidly moving surface and are free along it.

    points, normals (b, 3): the surface at rest, normals outward; motion(fraction) is where it has moved to.
    """

    nodes: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    motion: Callable[[float], RigidMotion]


def sliding_sets(model: PatientModel, plan: Plan) -> list[SlidingSet]:
    """The sliding nodes of a patient, by the bone that carries them, in the motion of a plan."""
    sets, slides = [], model.node_type == SLIDING
    for index in np.unique(model.node_segment[slides]):
        motion = RigidMotion() if index < 0 else plan.motion(model.segments[index])
        nodes = np.flatnonzero(slides & (model.node_segment == index))
        sets.append(SlidingSet(nodes, *facing_bone(model, index), motion.fraction))
    return sets


def facing_bone(model: PatientModel, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Bone of a segment that faces its tissue: without the far side of thin plates, whose normals would cancel."""
    tissue = np.flatnonzero((model.node_segment == index) & np.isin(model.node_type, (MOVING, SLIDING)))
    bone = model.bone_segment == index
    points, normals = model.bone_points[bone], model.bone_normals[bone]
    if len(points) < 4:
        name = segment_name(index, model.segments)
        raise InputError("-", "model", f"sliding nodes on segment {name!r}, which has no surface", "rebuild the model")
    away, nearest = cKDTree(model.points[tissue]).query(points)
    outward = model.node_normal[tissue[nearest]]
    keep = (away < REACH) & (np.einsum("bi,bi->b", normals, outward) < 0.3)
    keep &= np.linalg.norm(normals, axis=1) > 0.5
    return points[keep], normals[keep]


class SlidingSurfaces:
    """The sliding sets of one mesh, points (n, 3) mm: holds their nodes on the level sets of their surfaces where they
    started."""

    def __init__(self, points, sets):
        self.points = np.asarray(points, float)
        self.sets = [item for item in sets if len(item.nodes)]
        self.nodes = np.concatenate([np.zeros(0, int)] + [np.asarray(item.nodes, int) for item in self.sets])
        self.bones = _bones(self.points, self.nodes, self.sets)

    def under(self, sets) -> "SlidingSurfaces":
        """The same nodes on the same surfaces in another motion."""
        other = copy.copy(self)
        other.sets = [replace(item, motion=cache(item.motion)) for item in sets if len(item.nodes)]
        return other

    def at(self, fraction: float) -> "SlidingNodes":
        """The nodes on their bones as these lie at a fraction of the load."""
        return SlidingNodes(self.bones, [item.motion(fraction) for item in self.sets])

    def carry(self, displacement, start: float, end: float) -> np.ndarray:
        """Displacement (n, 3) with the sliding nodes carried by their surfaces from fraction `start` to `end`."""
        moved = np.array(displacement, float)
        for item in self.sets:
            rest = self.points[item.nodes]
            here = item.motion(start).inverse(rest + moved[item.nodes])
            moved[item.nodes] = item.motion(end).apply(here) - rest
        return moved


def _frames(normals) -> np.ndarray:
    """Right-handed orthonormal axes (s, 3, 3), the first along each normal (s, 3)."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-12, normals / np.maximum(length, 1e-12), [1.0, 0, 0])
    other = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    tangent = np.cross(normals, other)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack([normals, tangent, np.cross(normals, tangent)], axis=1)


class Bones(NamedTuple):
    """What the kernels read of nodes (s,) and of the bones that they slide on.

    rest (s, 3) mm: the nodes; owner (s,): their bone; level (s,) mm: their distance from it; frames (s, 3, 3): their
    axes at rest. points, normals (b, 3): of all bones, those of bone i from first[i] on; width (i,) mm2: squared
    spacing of its points; count (i,): how many of them count. near (s, k): places in points by distance (s, k) mm from
    the node, -1 where there are fewer.
    """

    nodes: np.ndarray
    rest: np.ndarray
    owner: np.ndarray
    level: np.ndarray
    frames: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    first: np.ndarray
    width: np.ndarray
    count: np.ndarray
    near: np.ndarray
    away: np.ndarray


def _bones(points: np.ndarray, nodes: np.ndarray, sets: list[SlidingSet]) -> Bones:
    """The bones of sliding sets, whose nodes (s,) lie at points (n, 3) mm; InputError for a surface that is none."""
    surfaces = [(np.asarray(item.points, float), _units(item)) for item in sets]
    first = np.concatenate([[0], np.cumsum([len(places) for places, _ in surfaces])]).astype(np.int64)
    owner = np.repeat(np.arange(len(sets)), [len(item.nodes) for item in sets])
    near, away = np.full((len(nodes), NEAREST), -1), np.full((len(nodes), NEAREST), np.inf)
    width, used, rest = np.empty(len(sets)), np.empty(len(sets), np.int64), points[nodes]
    for index, (places, _) in enumerate(surfaces):
        tree = cKDTree(places)
        width[index] = max(float(tree.query(places, 7)[0][:, 1:].mean()), 1e-6) ** 2
        within = tree.query_ball_point(places, WIDTHS * np.sqrt(width[index]), return_length=True)
        used[index] = min(int(within.max()) + 1, len(places))
        carried, count = owner == index, min(NEAREST, len(places))
        distance, place = tree.query(rest[carried], count)
        near[carried, :count], away[carried, :count] = first[index] + place, distance
    bones = Bones(
        nodes=nodes,
        rest=rest,
        owner=owner,
        level=np.zeros(len(nodes)),
        frames=np.zeros((len(nodes), 3, 3)),
        points=np.concatenate([np.zeros((0, 3)), *(places for places, _ in surfaces)]),
        normals=np.concatenate([np.zeros((0, 3)), *(normals for _, normals in surfaces)]),
        first=first,
        width=width,
        count=used,
        near=near,
        away=away,
    )
    normals = np.empty((len(nodes), 3))
    _levels(bones, bones.level, normals)
    return bones._replace(frames=_frames(normals))


def _units(item: SlidingSet) -> np.ndarray:
    """Unit normals (b, 3) of a set's surface; InputError where it is none."""
    normals = np.asarray(item.normals, float)
    if len(normals) < 8:
        raise InputError("-", "sliding", f"a surface of {len(normals)} points", "give at least 8 points")
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    if not (np.isfinite(item.points).all() and np.isfinite(length).all() and (length > 0).all()):
        raise InputError("-", "sliding", "a surface point or normal is not finite", "mend the surface")
    return normals / length


class SlidingNodes:
    """The nodes on their bones, each of which lies where a motion takes it.

    turns (c, 3, 3), shifts (c, 3) mm: the rigid motion of each bone.
    """

    def __init__(self, bones: Bones, motions: list[RigidMotion]):
        self._bones = bones
        self.turns = np.array([motion.rotation for motion in motions]).reshape(-1, 3, 3)
        self.shifts = np.array([motion.apply(np.zeros((1, 3)))[0] for motion in motions]).reshape(-1, 3)

    def part(self, which, nodes) -> "SlidingNodes":
        """Some of the nodes alone, by their places (k,) here, as nodes (k,) of a part of the mesh."""
        other, bones = copy.copy(self), self._bones
        some = {name: getattr(bones, name)[which] for name in ("rest", "owner", "level", "frames", "near", "away")}
        other._bones = bones._replace(nodes=nodes, **some)
        return other

    def project(self, u: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
        """Local axes (s, 3, 3) of the nodes, in rows, the normal first; moves their displacement in u (n, 3) mm along
        the normal to where their distance from the bone is that at rest, to the tolerance in mm if it can.

        The axes are those at rest, turned by their bone and no further than the normal of its surface asks, so that
        they change no faster than the surface bends.
        """
        axes = np.empty((len(self._bones.nodes), 3, 3))
        _project(u, self._bones, self.turns, self.shifts, axes, tolerance)
        return axes

    def frames(self, u) -> np.ndarray:
        """The axes of :meth:`project` where the nodes are, under u (n, 3) mm."""
        return self.project(np.array(u, float, order="C"), np.inf)

    def curvature(self, u, axes, force) -> np.ndarray:
        """What the bend of the surfaces adds to the tangent, (s, 3, 3) mN/mm in local axes, zero along the first.

        The Hessian of the energy on a level set of g is K - (force . grad g / |grad g|^2) d2g along it; force (s, 3) in
        mN is the gradient of the energy. d2g is taken by central differences of the gradient.
        """
        blocks = np.zeros((len(self._bones.nodes), 3, 3))
        _curvature(np.ascontiguousarray(u, float), self._bones, self.turns, self.shifts, axes, force, blocks)
        return blocks

    def violation(self, u) -> np.ndarray:
        """Gap (s,) in mm that opened (positive) or closed (penetration, negative) between the nodes and their bones."""
        gaps = np.empty(len(self._bones.nodes))
        _violation(np.ascontiguousarray(u, float), self._bones, self.turns, self.shifts, gaps)
        return gaps


@compiled
def _enclosing(values, count, high):
    """A bound that `count` of the values (k,), from 0 to `high`, do not exceed. Found by counting, in a fraction of the
    time of a partition: of squared distances from a surface there are as many as they are large."""
    low, below, within = 0.0, 0, len(values)
    for step in range(40):
        share = 0.5 if step % 3 == 2 else (count - 0.5 - below) / (within - below)
        bound, met = low + share * (high - low), 0
        for value in values:
            met += value <= bound
        if met == count:
            return bound
        if met < count:
            low, below = bound, met
        else:
            high, within = bound, met
    return np.partition(values, count - 1)[count - 1]


@compiled
def _field(x, s, bones: Bones, near, square, weight, plane, gradient):
    """Signed distance of x (3,) mm from the bone of node s; its gradient (3,)."""
    bone = bones.owner[s]
    start, end, width, count = bones.first[bone], bones.first[bone + 1], bones.width[bone], bones.count[bone]
    moved = 0.0
    for i in range(3):
        moved += (x[i] - bones.rest[s, i]) ** 2
    moved, listed, used, reach, farthest = np.sqrt(moved), min(bones.near.shape[1], end - start), 0, 0.0, np.inf
    # Of a node that has moved little a few more are enough; the list goes on where they do not reach.
    while used < listed and not (reach > 0 and reach * reach > farthest):
        more = min(2 * used if used else count + 32, listed)
        for k in range(used, more):
            b = bones.near[s, k]
            a0, a1, a2 = x[0] - bones.points[b, 0], x[1] - bones.points[b, 1], x[2] - bones.points[b, 2]
            near[k], square[k] = b, a0 * a0 + a1 * a1 + a2 * a2
        used, away = more, bones.away[s, more - 1]
        reach = away - moved
        if used >= count:
            farthest = _enclosing(square[:used], count, (away + moved) ** 2)
    if used < end - start and not (reach > 0 and reach * reach > farthest):
        used = end - start
        for k in range(used):
            b = start + k
            a0, a1, a2 = x[0] - bones.points[b, 0], x[1] - bones.points[b, 1], x[2] - bones.points[b, 2]
            near[k], square[k] = b, a0 * a0 + a1 * a1 + a2 * a2
        farthest = np.partition(square[:used], count - 1)[count - 1]
    count, least, total = 0, np.inf, 0.0
    for k in range(used):
        if square[k] <= farthest:
            near[count], square[count] = near[k], square[k]
            least = min(least, square[k])
            count += 1
    for k in range(count):
        weight[k] = np.exp((least - square[k]) / width)
        total += weight[k]
    n0, n1, n2, o0, o1, o2, first = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        b = near[k]
        weight[k] /= total
        w = weight[k]
        a0, a1, a2 = x[0] - bones.points[b, 0], x[1] - bones.points[b, 1], x[2] - bones.points[b, 2]
        m0, m1, m2 = bones.normals[b, 0], bones.normals[b, 1], bones.normals[b, 2]
        plane[k] = a0 * m0 + a1 * m1 + a2 * m2
        n0, n1, n2 = n0 + w * m0, n1 + w * m1, n2 + w * m2
        o0, o1, o2 = o0 + w * a0, o1 + w * a1, o2 + w * a2
        first += w * plane[k]
    length = max(np.sqrt(n0 * n0 + n1 * n1 + n2 * n2), 1e-3)
    n0, n1, n2 = n0 / length, n1 / length, n2 / length
    second = n0 * o0 + n1 * o1 + n2 * o2
    g0, g1, g2 = n0 * (1 + length), n1 * (1 + length), n2 * (1 + length)
    t0, t1, t2 = (o0 - second * n0) / length, (o1 - second * n1) / length, (o2 - second * n2) / length
    for k in range(count):
        b = near[k]
        a0, a1, a2 = x[0] - bones.points[b, 0], x[1] - bones.points[b, 1], x[2] - bones.points[b, 2]
        # d weight/dx = -2/width weight (offset - mean offset): derivatives of averages are covariances.
        along = plane[k] + t0 * bones.normals[b, 0] + t1 * bones.normals[b, 1] + t2 * bones.normals[b, 2]
        along = -2 / width * weight[k] * (along + a0 * n0 + a1 * n1 + a2 * n2)
        g0, g1, g2 = g0 + along * (a0 - o0), g1 + along * (a1 - o1), g2 + along * (a2 - o2)
    gradient[0], gradient[1], gradient[2] = g0 / 2, g1 / 2, g2 / 2
    return (first + second) / 2


@compiled
def _inside(u, s, bones: Bones, turn, shift, x):
    """Where node s is in the frame of its bone at rest, into x (3,)."""
    for j in range(3):
        x[j] = 0.0
        for i in range(3):
            x[j] += turn[i, j] * (bones.rest[s, i] + u[bones.nodes[s], i] - shift[i])


@compiled
def _levels(bones: Bones, level, normals):
    size = len(bones.points)
    near, square, weight, plane = np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty(size)
    for s in range(len(bones.nodes)):
        level[s] = _field(bones.rest[s], s, bones, near, square, weight, plane, normals[s])


@compiled
def _violation(u, bones: Bones, turns, shifts, gaps):
    size = len(bones.points)
    near, square, weight, plane = np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty(size)
    x, gradient = np.empty(3), np.empty(3)
    for s in range(len(bones.nodes)):
        _inside(u, s, bones, turns[bones.owner[s]], shifts[bones.owner[s]], x)
        gaps[s] = _field(x, s, bones, near, square, weight, plane, gradient) - bones.level[s]


@compiled
def _project(u, bones: Bones, turns, shifts, axes, tolerance):
    size = len(bones.points)
    near, square, weight, plane = np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty(size)
    x, gradient, normal, carried, axis = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    for s in range(len(bones.nodes)):
        turn, shift = turns[bones.owner[s]], shifts[bones.owner[s]]
        _inside(u, s, bones, turn, shift, x)
        moved = False
        for _ in range(200):
            gap = bones.level[s] - _field(x, s, bones, near, square, weight, plane, gradient)
            if abs(gap) <= tolerance:
                break
            slope = gradient[0] ** 2 + gradient[1] ** 2 + gradient[2] ** 2
            # A step is never longer than 2 mm: across a sharp edge the gradient says little about what lies beyond.
            way = gap / max(slope, 0.01)
            way *= min(1.0, 2 / max(abs(way) * np.sqrt(slope), 1e-30))
            for i in range(3):
                x[i] += way * gradient[i]
            moved = True
        if moved:
            for i in range(3):
                place = shift[i] - bones.rest[s, i]
                for j in range(3):
                    place += turn[i, j] * x[j]
                u[bones.nodes[s], i] = place
        length = max(np.sqrt(gradient[0] ** 2 + gradient[1] ** 2 + gradient[2] ** 2), 1e-12)
        for i in range(3):
            normal[i] = 0.0
            for j in range(3):
                normal[i] += turn[i, j] * gradient[j] / length
            for r in range(3):
                carried[r, i] = 0.0
                for j in range(3):
                    carried[r, i] += bones.frames[s, r, j] * turn[i, j]
        _turned(carried, normal, axis, axes[s])


@compiled
def _turned(carried, normal, axis, axes):
    """Axes (3, 3) in rows, turned the shortest way so that the first is the normal; others where it points back."""
    cosine = 0.0
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        axis[i] = carried[0, p] * normal[q] - carried[0, q] * normal[p]
        cosine += carried[0, i] * normal[i]
    if cosine <= -0.9:
        least = 0
        for i in range(3):
            axes[0, i] = normal[i]
            if abs(normal[i]) < abs(normal[least]):
                least = i
        size = np.sqrt(max(1 - normal[least] ** 2, 1e-30))
        p, q = (least + 1) % 3, (least + 2) % 3
        axes[1, least], axes[1, p], axes[1, q] = 0.0, normal[q] / size, -normal[p] / size
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            axes[2, i] = normal[p] * axes[1, q] - normal[q] * axes[1, p]
        return
    # Rodrigues: v -> v + axis x v + axis x (axis x v) / (1 + cosine)
    for r in range(3):
        v = carried[r]
        c0, c1, c2 = axis[1] * v[2] - axis[2] * v[1], axis[2] * v[0] - axis[0] * v[2], axis[0] * v[1] - axis[1] * v[0]
        axes[r, 0] = v[0] + c0 + (axis[1] * c2 - axis[2] * c1) / (1 + cosine)
        axes[r, 1] = v[1] + c1 + (axis[2] * c0 - axis[0] * c2) / (1 + cosine)
        axes[r, 2] = v[2] + c2 + (axis[0] * c1 - axis[1] * c0) / (1 + cosine)


@compiled
def _curvature(u, bones: Bones, turns, shifts, axes, force, blocks):
    size, step = len(bones.points), 1e-3
    near, square, weight, plane = np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty(size)
    x, there, gradient, change, tangents = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3))
    for s in range(len(bones.nodes)):
        turn = turns[bones.owner[s]]
        _inside(u, s, bones, turn, shifts[bones.owner[s]], x)
        _field(x, s, bones, near, square, weight, plane, gradient)
        slope, pull = 0.0, 0.0
        for j in range(3):
            slope += gradient[j] ** 2
            for i in range(3):
                pull += force[s, i] * turn[i, j] * gradient[j]
        for c in range(2):
            for j in range(3):
                tangents[c, j] = 0.0
                for i in range(3):
                    tangents[c, j] += axes[s, c + 1, i] * turn[i, j]
        for c in range(2):
            change[:] = 0.0
            for sign in (1.0, -1.0):
                for i in range(3):
                    there[i] = x[i] + sign * step * tangents[c, i]
                _field(there, s, bones, near, square, weight, plane, gradient)
                for i in range(3):
                    change[i] += sign * gradient[i] / (2 * step)
            for d in range(2):
                change_along = tangents[d, 0] * change[0] + tangents[d, 1] * change[1] + tangents[d, 2] * change[2]
                change_along *= -pull / max(slope, 1e-12) / 2
                blocks[s, d + 1, c + 1] += change_along
                blocks[s, c + 1, d + 1] += change_along
