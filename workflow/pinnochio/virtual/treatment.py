"""The plan that treats a virtual patient's own deformity, and the bite and contacts that it leads to."""

from itertools import combinations

import numpy as np

from pinnochio.model.labels import CRANIUM, segment_code
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, displacement_at, of_role
from pinnochio.plans.sampling import (
    CHIN_ADVANCE,
    JawAnatomy,
    autorotation,
    compose_plan,
    motion,
    sample_maxilla,
    truncated,
)
from pinnochio.virtual.head import Head
from pinnochio.virtual.parameters import NORMAL_OVERJET, REST_GAP, TABLE, HeadParameters
from pinnochio.virtual.skeleton import Skeleton

CONTACT = 8.0  # mm3 of upper and lower jaw in the same place: contact of the teeth, not overlap [I]
OPENING, LARGEST_OPENING = 0.25, 3.0  # mm by which the lower jaw is lowered until the teeth only touch
LEAST_ADVANCE = 2.0  # mm of the chin below which nobody operates on it [I]


def jaw_anatomy(head: Head) -> JawAnatomy:
    """Reference points of the segments, from the voxels of the head."""
    points = [voxels(head, name) for name in head.segments]
    segment = np.repeat(np.arange(len(points)), [len(bone) for bone in points])
    return JawAnatomy.from_points(np.concatenate(points), segment, head.segments)


def voxels(head: Head, segment: str) -> np.ndarray:
    """Voxel centres (n, 3) mm of a segment, or of the cranium."""
    return np.argwhere(head.labels == code_of(head, segment)) * head.spacing + head.origin


def code_of(head: Head, bone: str) -> int:
    """Label code of a segment, or of the cranium."""
    return CRANIUM if bone == "cranium" else segment_code(head.segments.index(bone))


def overlap(head: Head, plan: Plan, one: str, other: str) -> float:
    """Volume (mm3) that two segments share once both are moved: voxels of `one` that land in voxels of `other`."""
    places = plan.motion(other).inverse(plan.motion(one).apply(voxels(head, one)))
    index = np.round((places - head.origin) / head.spacing).astype(int)
    index = index[((index >= 0) & (index < head.labels.shape)).all(1)]
    return float((head.labels[tuple(index.T)] == code_of(head, other)).sum() * head.spacing.prod())


def jaw_overlap(head: Head, plan: Plan) -> float:
    """Volume (mm3) in which the upper and lower jaws, with their teeth, overlap once they are moved."""
    upper = of_role(head.segments, "maxilla") or ["cranium"]
    lower = of_role(head.segments, "distal", UNCUT, "chin")
    return sum(overlap(head, plan, one, other) for one in lower for other in upper)


def split_overlaps(head: Head, plan: Plan) -> dict[str, float]:
    """Volume (mm3) that the moved pieces of the mandible share, by their names: bone that the surgeon trims."""
    upper = of_role(head.segments, "maxilla")
    pairs = [pair for pair in combinations(head.segments, 2) if not {*pair} & {*upper}]
    return {f"{one}/{other}": overlap(head, plan, one, other) for one, other in pairs}


def treatment_plan(head: Head, rng: np.random.Generator, case: str) -> Plan:
    """Plan of the head's procedure that brings the patient's overjet, open bite, midline and cant close to normal.

    Two jaws: the maxilla's motion is drawn as usual for the deformity, with small turns and midline shift only, and the
    lower jaw is set against it. Lower jaw alone: it is set against the maxilla where that is. Upper jaw alone: the
    maxilla's height is drawn, the mandible turns about its condyles until it meets that height, and the maxilla is set
    against it. The bite is corrected to a residue of 0.5 mm (SD) per direction [I]. Where the teeth would overlap, the
    lower jaw is set lower until they only touch. A chin segment goes where the patient's chin lacks prominence.
    """
    p, s = head.parameters, Skeleton(head.parameters)
    upper, lower = s.upper_incisor, s.lower_incisor
    anatomy = jaw_anatomy(head)
    centres = [anatomy.centre[name] for name in of_role(head.segments, "maxilla")]
    drawn = maxilla = sample_maxilla(rng, p.deformity, np.mean(centres or [upper], 0), spread=0.3)
    residue = np.array([truncated(rng, 0, 0.5, -1, 1) for _ in range(3)])
    goal = upper + [0, NORMAL_OVERJET, -REST_GAP]
    shift = (goal - lower) * [1, -1, 1] + residue
    molar = s.molar_y - lower[1]
    pitch = -np.degrees(np.arctan(p.open_bite / molar))
    roll = -np.degrees(np.arctan(p.occlusal_cant / s.gonion[0]))
    yaw = -np.degrees(np.arctan(p.chin_deviation / (s.condyle[1] - s.pogonion[1])))
    follow = rng.integers(2**32)  # the rami's draws do not depend on how often the jaws had to be parted
    for down in np.arange(0, LARGEST_OPENING + OPENING, OPENING):
        jaw, turn = motion((pitch, 0.7 * roll, 0.7 * yaw), shift - [0, 0, down], lower), None
        if UNCUT in head.segments:
            gap = np.array([0, NORMAL_OVERJET, -REST_GAP - down])
            turn = turn_to(lower, anatomy.hinge[UNCUT], (upper + drawn.translation + gap)[2])
            met = autorotation(anatomy, UNCUT, turn).apply(lower[None])[0] - gap
            # The planes of the bite stay as parallel as a corrected lower jaw would make them.
            turns = drawn.degrees + [turn - pitch, 0, 0]
            maxilla = motion(turns, (met - upper) * [1, -1, 1] - residue, upper)
        draws = np.random.default_rng(follow)
        plan = compose_plan(draws, case, anatomy, maxilla, jaw, chin_advance(p), turn)
        if jaw_overlap(head, plan) <= CONTACT:
            break
    return plan


def chin_advance(parameters: HeadParameters) -> float:
    """How far (mm) a genioplasty brings the chin forward: what it lacks to its mean prominence, within practice and at
    least what one operates for."""
    entry = TABLE["chin_prominence"]
    lacking = entry.mean + parameters.male * entry.male - parameters.chin_prominence
    return float(np.clip(lacking, LEAST_ADVANCE, CHIN_ADVANCE[3]))


def turn_to(point: np.ndarray, hinge: np.ndarray, height: float) -> float:
    """Degrees about the transverse axis through the hinge that take a point (3,) mm in front of it to z = height."""
    y, z = (point - hinge)[1:]
    share = np.clip((height - hinge[2]) / np.hypot(y, z), -1, 1)
    degrees = np.degrees(np.pi - np.arcsin(share) - np.arctan2(z, y))
    return float((degrees + 180) % 360 - 180)


def bite(parameters: HeadParameters, plan: Plan | None = None) -> dict[str, float]:
    """Overjet, open bite and midline (mm) at the incisor edges: before surgery, or once a plan is carried out."""
    s, plan = Skeleton(parameters), plan or Plan("-", {})
    edges = (("lower", s.lower_incisor), ("upper", s.upper_incisor))
    lower, upper = (point + displacement_at(plan, jaw, point[None])[0] for jaw, point in edges)
    gap = lower - upper
    return {"overjet": float(gap[1]), "open_bite": float(-gap[2] - REST_GAP), "midline": float(gap[0])}
