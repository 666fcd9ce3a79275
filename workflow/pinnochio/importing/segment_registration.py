"""Finds the rigid motion that surgery gave each bone segment, from the bones of a post-operative scan in any frame.

The cranium, which surgery leaves alone, brings the scan into the patient's frame. Then each segment is moved onto the
scanned bone by point-to-plane steps on what of its surface was visible before surgery. Steps and search are those of
the skin's registration (:mod:`pinnochio.importing.registration`).
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.columns import Column
from pinnochio.errors import refusal
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.importing.registration import coarse, spread, step, upper_face_plane
from pinnochio.importing.segmentation import Segmentation
from pinnochio.importing.stable_skin import Certainty, likeliest
from pinnochio.model.labels import CRANIUM, segment_name
from pinnochio.model.surfaces import bone_surface
from pinnochio.plans.plan import Plan

LOG = logging.getLogger(__name__)
NARROWLY = 0.9  # of a limit from which a fit that passes is said to be near it
EDGE = 1.5  # mm of the segments' surfaces: finer than those of the model
HIDDEN, RIM = 2.0, 3.0  # mm: bone so near in front of a point hides it; so near the volume's border is a cut
SAMPLES, FEW, COARSE_SAMPLES = 8000, 800, 700
TUKEY = 3.0  # standard deviations of the noise beyond which a pair counts nothing: plates and callus lie near [X]
TURNED = 4.0  # mm that a mismatch of the normals by one radian counts when nearest points are looked for
COMPATIBLE = 0.7  # cosine between normals of a pair
REACHES = (10.0, 6.0, 3.5, 2.0)  # mm within which a pair is looked for, one pass after the other
STEPS, SETTLED = 25, (0.02, 0.002)  # of a pass at most; mm of a step that ends it, in all passes but the last and there
LEAST_SPREAD = 0.05  # mm
PAIRS = 1500  # of the cranium that say how certain its registration is
MATCHED, CUT = 1.0, 3.0  # mm: a point so near bone is matched; beyond this, a point tells nothing but that it has none
UNMOVED = 0.3, 0.5  # mm and degrees that a registered motion is true to: a bone that moved less has not moved
PLANNED = 1.0  # mm from its plan at which a segment that has not moved is odd [I]
FEWEST = 60  # points of a segment that can be registered

FITS = (
    Column("case", str, "", "patient"),
    Column("segment", str, "", "bone; the cranium registers the whole scan"),
    Column("points", int, "", "registered points of its visible surface"),
    Column("median", float, "mm", "median distance from the scanned bone", ".3f"),
    Column("p90", float, "mm", "90th percentile of the distance", ".3f"),
    Column("matched", float, "%", "points with scanned bone of the same orientation within 1 mm", ".1f"),
    Column("from_plan", float, "mm", "mean distance of the surface from the plan", ".3f"),
    Column("from_plan_degrees", float, "deg", "angle between the registered and the planned motion", ".3f"),
)


@dataclass(frozen=True)
class SegmentFit:
    """A segment's motion, and how well it explains the scan.

    The numbers are the columns of :data:`FITS`; distances run along the normals, from points that have bone within CUT
    that faces the same way.
    """

    segment: str
    motion: RigidMotion
    points: int
    median: float
    p90: float
    matched: float
    from_plan: float
    from_plan_degrees: float


class ScannedBone:
    """The scanned bone as points with normals, looked up by place and direction."""

    def __init__(self, points: np.ndarray, normals: np.ndarray):
        self.points, self.normals = points, normals
        self.tree = cKDTree(np.hstack([points, TURNED * normals]))

    def pairs(self, placed, normals, reach: float):
        """Which points `placed` have bone within `reach`, its places, and the offsets along the points' own normals,
        which have less noise than the scan's."""
        near = self.tree.query(np.hstack([placed, TURNED * normals]), distance_upper_bound=reach + TURNED)[1]
        within = near < len(self.points)
        near = near[within]
        away = self.points[near] - placed[within]
        fit = np.einsum("ij,ij->i", self.normals[near], normals[within]) > COMPATIBLE
        fit &= np.einsum("ij,ij->i", away, away) < reach**2
        used = np.flatnonzero(within)[fit]
        return used, self.points[near[fit]], np.einsum("ij,ij->i", away[fit], normals[used])


@dataclass(frozen=True)
class VisibleBone:
    """Visible points (k, 3) mm of a bone before surgery with normals, evenly over its area; few: some of them."""

    points: np.ndarray
    normals: np.ndarray
    few: np.ndarray


def register_bones(
    head: Segmentation,
    segments: Sequence[str],
    plan: Plan,
    points: np.ndarray,
    faces: np.ndarray,
    *,
    case: str,
    file: object,
) -> tuple[SegmentFit, list[SegmentFit]]:
    """The cranium's registration (its motion: patient -> scanner) and that of each segment of the case.

    head: the labels before surgery, internal codes; plan: the planned motions, from which the search begins; points
    (p, 3) mm, faces (f, 3): the scanned bones, outward, in any frame. A segment's motion is in the patient's frame and
    relative to the cranium, about its own centre. InputError where there is no cranium to register on; nothing else is
    refused here (:func:`check_fits`).
    """
    refuse = refusal(case, file)
    bone, scanned, frame = _framed(head, segments, points, faces, refuse)
    fits = []
    for index in np.unique(bone.segment).astype(int):
        source, name = _source(bone.part(index), head), segment_name(index, tuple(segments))
        planned = RigidMotion() if index < 0 else plan.motion(name)
        if index < 0:
            motion = RigidMotion()
        elif len(source.points) < FEWEST:
            refuse(f"hardly any surface of {name!r} is free of other bone", "check its labels")
        else:
            tried = [fitted(source, scanned, start) for start in (planned, RigidMotion())]
            motion = min(tried, key=lambda motion: _cost(source, scanned, motion)).about(source.points.mean(axis=0))
        fits.append(_judged(name, source, scanned, motion, planned, frame))
    return fits[0], fits[1:]


def register_cranium(
    head: Segmentation, segments: Sequence[str], points: np.ndarray, faces: np.ndarray, *, case: str, file: object
) -> tuple[SegmentFit, Certainty]:
    """The cranium's registration alone (its motion: patient -> scanner), as of :func:`register_bones`, and how certain
    it is in the patient's frame."""
    bone, scanned, frame = _framed(head, segments, points, faces, refusal(case, file))
    cranium = _source(bone.part(-1), head)
    used, _, off = scanned.pairs(cranium.points, cranium.normals, CUT)
    few = np.arange(0, len(used), max(1, len(used) // PAIRS))
    places = cranium.points[used[few]], off[few], cranium.normals[used[few]]
    certainty = likeliest(*places, np.zeros(len(few)))[1] if len(few) >= FEWEST else Certainty.none()
    return _judged("cranium", cranium, scanned, RigidMotion(), RigidMotion(), frame), certainty


def _framed(head: Segmentation, segments: Sequence[str], points, faces, refuse):
    """The bones before surgery, the scanned bone brought into their frame by the cranium, and that frame, patient ->
    scanner."""
    bone = bone_surface(*head.label_map, tuple(segments), EDGE)
    cranium = _source(bone.part(-1), head)
    if len(cranium.points) < FEWEST:
        refuse("hardly any cranium is segmented before surgery", "segment it up to the orbits")
    normals = vertex_normals(points, faces)
    chosen = spread(points, faces, COARSE_SAMPLES)
    plane = upper_face_plane(bone, tuple(segments), 0.0)
    rotation, shift = coarse(points[chosen], normals[chosen], bone.points, bone.faces, plane, bone.points)
    scanned = ScannedBone(points @ rotation.T + shift, normals @ rotation.T)
    back = fitted(cranium, scanned, RigidMotion())  # what is left to turn, from the patient to the scan
    frame = RigidMotion(rotation.T @ back.rotation, rotation.T @ (back.translation - shift))
    return bone, ScannedBone(back.inverse(scanned.points), scanned.normals @ back.rotation), frame


def check_fits(fits: Sequence[SegmentFit], *, limit: float, share: float, case: str, file: object) -> None:
    """Refuse (InputError) a bone whose median distance exceeds `limit` mm or whose matched share is below `share` %.

    And a scan in which every segment is where it was although the plan moves one: the bones before surgery.
    """
    refuse = refusal(case, file)
    segments = [fit for fit in fits if fit.segment != "cranium"]
    still = [np.linalg.norm(fit.motion.translation) < UNMOVED[0] and fit.motion.angle < UNMOVED[1] for fit in segments]
    if segments and all(still) and max(fit.from_plan for fit in segments) > PLANNED:
        farthest = max(segments, key=lambda fit: fit.from_plan)
        refuse(
            f"every segment is where it was before surgery, {farthest.segment!r} {farthest.from_plan:.1f} mm from "
            "where the plan takes it",
            "give the bones after surgery, not those before; or leave postop_bones empty",
        )
    for fit in fits:
        if not (fit.median <= limit and fit.matched >= share):
            refuse(
                f"{fit.segment!r} registered on the scanned bone leaves a median distance of {fit.median:.2f} mm "
                f"(limit {limit:g} mm) and has bone within {MATCHED:g} mm of {fit.matched:.0f} % of its surface "
                f"(at least {share:g} % is asked)",
                "check that these are all bones of this patient after surgery, not mirrored; or leave postop_bones "
                "empty, and the case is predicted from its plan",
            )
        if fit.median > NARROWLY * limit or fit.matched < 100 - NARROWLY * (100 - share):
            said = f"median distance {fit.median:.3f} of {limit:g} mm, {fit.matched:.0f} % matched of {share:g}"
            LOG.warning("case %r: %s: %r fits the scanned bone narrowly: %s", case, file, fit.segment, said)


def _source(part, head: Segmentation) -> VisibleBone:
    """What was visible of a bone before surgery: neither cut by the volume's border nor against another bone."""
    import trimesh  # half a second, which a plan given as motions is spared

    # Middles of the edges too: the more points on a small bone, the less the noise of each counts.
    points, faces = trimesh.remesh.subdivide(part.points, part.faces)
    normals = vertex_normals(points, faces)
    low, high = head.origin, head.origin + head.spacing * (np.array(head.labels.shape) - 1)
    seen = ((points > low + RIM) & (points < high - RIM)).all(axis=1)
    for step_out in (0.5 * HIDDEN, HIDDEN):
        index = np.round((points + step_out * normals - head.origin) / head.spacing).astype(int)
        index = np.clip(index, 0, np.array(head.labels.shape) - 1)
        seen &= head.labels[tuple(index.T)] < CRANIUM
    chosen = spread(points, faces[seen[faces].all(axis=1)], SAMPLES)
    step_over = max(1, len(chosen) // FEW)
    return VisibleBone(points[chosen], normals[chosen], np.arange(0, len(chosen), step_over))


def fitted(source: VisibleBone, target: ScannedBone, start: RigidMotion) -> RigidMotion:
    """The motion nearest to `start` that brings the points onto the target."""
    rotation, shift = start.rotation, start.apply(np.zeros((1, 3)))[0]
    for reach in REACHES:
        last = reach == REACHES[-1]
        points, normals = (source.points, source.normals) if last else (
            source.points[source.few], source.normals[source.few]
        )  # fmt: skip
        for _ in range(STEPS):
            placed = points @ rotation.T + shift
            used, places, off = target.pairs(placed, normals @ rotation.T, reach)
            if len(used) < 20:
                break
            width = TUKEY * 1.4826 * max(np.median(np.abs(off)), LEAST_SPREAD)
            weights = np.clip(1 - (off / width) ** 2, 0, None) ** 2
            turn, move = step(placed[used], places, normals[used] @ rotation.T, weights)
            change = np.abs(placed @ (turn - np.eye(3)).T + move).max()
            rotation, shift = turn @ rotation, turn @ shift + move
            if change < SETTLED[last]:
                break
    return RigidMotion(rotation, shift)


def _cost(source: VisibleBone, target: ScannedBone, motion: RigidMotion) -> float:
    """Mean distance (mm) along the normals, cut off: what has no bone costs the same in any pose."""
    used, _, off = target.pairs(motion.apply(source.points), source.normals @ motion.rotation.T, CUT)
    return (np.abs(off).sum() + CUT * (len(source.points) - len(used))) / len(source.points)


def _judged(
    name: str, source: VisibleBone, target: ScannedBone, motion: RigidMotion, planned: RigidMotion, frame: RigidMotion
) -> SegmentFit:
    """How well a motion explains the scan; the motion of the cranium is the frame."""
    placed = motion.apply(source.points)
    off = np.abs(target.pairs(placed, source.normals @ motion.rotation.T, CUT)[2])
    return SegmentFit(
        segment=name,
        motion=frame if name == "cranium" else motion,
        points=len(source.points),
        median=float(np.median(off)) if len(off) else np.inf,
        p90=float(np.percentile(off, 90)) if len(off) else np.inf,
        matched=100 * float((off < MATCHED).sum()) / len(source.points),
        from_plan=float(np.linalg.norm(placed - planned.apply(source.points), axis=1).mean()),
        from_plan_degrees=motion.angle_from(planned),
    )
