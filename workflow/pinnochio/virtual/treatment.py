"""The plan that treats a virtual patient's own deformity, and the bite and contacts that it leads to."""

from itertools import combinations

import numpy as np

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.labels import segment_code
from pinnochio.plans.plan import Plan
from pinnochio.plans.sampling import (
    CHIN_ADVANCE,
    JawAnatomy,
    compose_plan,
    motion,
    role,
    sample_maxilla,
    truncated,
)
from pinnochio.virtual.head import Head
from pinnochio.virtual.parameters import NORMAL_OVERJET, REST_GAP, TABLE, HeadParameters
from pinnochio.virtual.skeleton import Skeleton

CONTACT = 8.0  # mm3 of upper and lower jaw in the same place: contact of the teeth, not overlap [I]
OPENING, LARGEST_OPENING = 0.25, 3.0  # mm by which the lower jaw is lowered until the teeth only touch


def jaw_anatomy(head: Head) -> JawAnatomy:
    """Reference points of the segments, from the voxels of the head."""
    points = [voxels(head, name) for name in head.segments]
    segment = np.repeat(np.arange(len(points)), [len(own) for own in points])
    return JawAnatomy.from_points(np.concatenate(points), segment, head.segments)


def voxels(head: Head, segment: str) -> np.ndarray:
    """Voxel centres (n, 3) mm of a segment."""
    return np.argwhere(head.labels == segment_code(head.segments.index(segment))) * head.spacing + head.origin


def overlap(head: Head, plan: Plan, one: str, other: str) -> float:
    """Volume (mm3) that two segments share once both are moved: voxels of `one` that land in voxels of `other`."""
    places = plan.motion(other).inverse(plan.motion(one).apply(voxels(head, one)))
    index = np.round((places - head.origin) / head.spacing).astype(int)
    index = index[((index >= 0) & (index < head.labels.shape)).all(1)]
    code = segment_code(head.segments.index(other))
    return float((head.labels[tuple(index.T)] == code).sum() * head.spacing.prod())


def jaw_overlap(head: Head, plan: Plan) -> float:
    """Volume (mm3) in which the moved upper and lower jaws, with their teeth, overlap."""
    upper = [name for name in head.segments if role(name) == "maxilla"]
    lower = [name for name in head.segments if role(name) in ("distal", "chin")]
    return sum(overlap(head, plan, one, other) for one in lower for other in upper)


def split_overlaps(head: Head, plan: Plan) -> dict[str, float]:
    """Volume (mm3) that the moved pieces of the mandible share, by their names: bone that the surgeon trims."""
    pairs = [pair for pair in combinations(head.segments, 2) if "maxilla" not in map(role, pair)]
    return {f"{one}/{other}": overlap(head, plan, one, other) for one, other in pairs}


def treatment_plan(head: Head, rng: np.random.Generator, case: str) -> Plan:
    """Bimaxillary plan that brings the patient's overjet, open bite, midline and cant close to normal.

    The maxilla's motion is drawn as usual for the deformity, with small turns and midline shift only;
    the bite is corrected to a residue of 0.5 mm (SD) per direction [I]. Where the teeth would overlap, the lower jaw
    is set lower until they only touch. A chin segment goes where the patient's chin lacks prominence.
    """
    p, s = head.parameters, Skeleton(head.parameters)
    upper, lower = s.upper_incisor, s.lower_incisor
    anatomy = jaw_anatomy(head)
    maxilla = sample_maxilla(rng, p.deformity, anatomy.centre.get("lefort1", upper), spread=0.3)
    residue = np.array([truncated(rng, 0, 0.5, -1, 1) for _ in range(3)])
    goal = upper + [0, NORMAL_OVERJET, -REST_GAP]
    shift = (goal - lower) * [1, -1, 1] + residue
    molar = s.molar_y - lower[1]
    pitch = -np.degrees(np.arctan(p.open_bite / molar))
    roll = -np.degrees(np.arctan(p.occlusal_cant / s.gonion[0]))
    yaw = -np.degrees(np.arctan(p.chin_deviation / (s.condyle[1] - s.pogonion[1])))
    follow = rng.integers(2**32)  # the rami's draws do not depend on how often the jaws had to be parted
    for down in np.arange(0, LARGEST_OPENING + OPENING, OPENING):
        jaw = motion((pitch, 0.7 * roll, 0.7 * yaw), shift - [0, 0, down], lower)
        plan = compose_plan(np.random.default_rng(follow), case, anatomy, maxilla, jaw, chin_advance(p))
        if jaw_overlap(head, plan) <= CONTACT:
            break
    return plan


def chin_advance(parameters: HeadParameters) -> float:
    """How far (mm) a genioplasty brings the chin forward: what it lacks to its mean prominence, within practice."""
    entry = TABLE["chin_prominence"]
    lacking = entry.mean + parameters.male * entry.male - parameters.chin_prominence
    return float(np.clip(lacking, *CHIN_ADVANCE[2:]))


def bite(parameters: HeadParameters, plan: Plan | None = None) -> dict[str, float]:
    """Overjet, open bite and midline (mm) at the incisor edges: before surgery, or once a plan is carried out."""
    s, motions = Skeleton(parameters), plan.motions if plan else {}
    maxilla, mandible = (motions.get(name, RigidMotion()) for name in ("lefort1", "mandible_distal"))
    gap = (mandible.apply(s.lower_incisor[None]) - maxilla.apply(s.upper_incisor[None]))[0]
    return {"overjet": float(gap[1]), "open_bite": float(-gap[2] - REST_GAP), "midline": float(gap[0])}
