"""Plans drawn at random within surgical practice, for any set of bone segments, and the error of carrying them out.

A bimaxillary plan is not two independent plans: the mandible first closes the bite against the maxilla and then
travels with it. So distal motion = maxilla's motion after the occlusal correction, and the rami follow by turning
about their condyles. The pieces of a segmental maxilla travel together and move little against each other. A mandible
that is not cut can but turn about both condyles, as far as the maxilla lets it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.plans.roles import FRONT, UNCUT, of_role, role

DEFORMITIES = ("class_ii", "class_iii", "asymmetry", "open_bite")
# Largest movements of practice [R: methods 7.2], mm and degrees: (left, forward, up) as low, high; (pitch, roll, yaw).
LIMITS = {
    "maxilla": (np.array([[-5.0, 5], [-4, 10], [-7, 7]]), np.array([10.0, 6, 6])),
    "distal": (np.array([[-10.0, 10], [-14, 12], [-10, 10]]), np.array([10.0, 6, 6])),
}
# mm at the centroid, degrees: three operated patients' rami turned by 4.7, 8.4 and 9.4 [X].
PROXIMAL_SHIFT, PROXIMAL_ANGLE = 5.0, 10.0
PROXIMAL_SCATTER = np.array([4.5, 1.5, 1.5])  # degrees, SD of the ramus' own pitch, roll and yaw [I] after these
FOLLOWED = 0.4  # share of the distal segment's motion beside it that a ramus follows [I]
AUTOROTATION = 6.0  # degrees: largest turn of an uncut mandible about its condyles [I]
WIDENING = (3.5, 1.0, 2.0, 5.0)  # mm between the molars of a segmental maxilla [R: 2 to 5]
PIECE_SHIFT = (0.0, 0.5, -1.0, 1.0)  # mm up of the front piece of a maxilla against the others [I]
PIECE_TURN = (0.0, 1.0, -2.0, 2.0)  # degrees about each axis, of each piece [I]
PIECE_ERROR = 0.3  # error of a piece of the maxilla against the others, over that of all: one splint holds them [I]
# Normal (mean, SD, low, high): maxilla forward and up, then the correction of the bite (lower jaw against upper):
# forward, midline (absolute), closing of an open bite. mm [R: methods 7.2 for the magnitudes, the shares are I].
MAXILLA = {
    "class_ii": ((2.0, 1.5, -2, 6), (1.0, 2.0, -5, 7)),
    "class_iii": ((4.0, 2.0, 0, 10), (0.0, 2.0, -7, 7)),
    "asymmetry": ((2.0, 1.5, -1, 6), (0.5, 1.5, -5, 7)),
    "open_bite": ((3.0, 2.0, 0, 10), (2.5, 1.5, 0, 7)),
}
BITE = {
    "class_ii": ((5.0, 1.8, 1.5, 9.5), (0.0, 0.8, -3, 3), (0.0, 0.4, -1, 1)),
    "class_iii": ((-7.0, 2.0, -12, -3), (0.0, 0.8, -3, 3), (0.0, 0.4, -1, 1)),
    "asymmetry": ((-1.0, 2.0, -5, 3), (5.0, 1.5, 2, 8), (0.0, 0.4, -1, 1)),
    "open_bite": ((0.5, 1.5, -3, 4), (0.0, 0.8, -3, 3), (4.0, 1.0, 2, 7)),
}
CHIN_ADVANCE = (5.0, 2.0, 0.0, 10.0)  # [R: methods 7.2]
# Mean and SD of the absolute error: left-right, front-back, vertical mm; pitch, roll, yaw degrees [S: PMC8432567].
EXECUTION = np.array([[0.61, 0.55], [0.86, 0.68], [1.00, 0.79], [1.43, 1.06], [0.50, 0.31], [0.58, 0.41]])


def truncated(rng: np.random.Generator, mean: float, sd: float, low: float, high: float) -> float:
    """One value of the normal (mean, sd) truncated to [low, high]."""
    return quantile(rng.random(), mean, sd, low, high)


def quantile(share: float, mean: float, sd: float, low: float, high: float) -> float:
    """The value of the normal (mean, sd) truncated to [low, high] below which this share of it lies."""
    from scipy.stats import truncnorm  # half a second, which whoever draws no plan is spared

    return float(truncnorm.ppf(share, (low - mean) / sd, (high - mean) / sd, loc=mean, scale=sd))


@dataclass(frozen=True)
class JawAnatomy:
    """Reference points (3,) mm by segment name: `centre`, `front` and `rear` of all, `hinge` of what has condyles: the
    condyle of a ramus, the middle between both of an uncut mandible."""

    centre: dict[str, np.ndarray]
    hinge: dict[str, np.ndarray]
    front: dict[str, np.ndarray]
    rear: dict[str, np.ndarray]

    @classmethod
    def from_points(cls, points: np.ndarray, segment: np.ndarray, segments: tuple[str, ...]) -> "JawAnatomy":
        """From bone points (b, 3), segment index (b,). The condyle is the top posterior part of a ramus."""
        centre, hinge, front, rear = {}, {}, {}, {}
        for index, name in enumerate(segments):
            bone = points[segment == index]
            if not len(bone):
                raise InputError("?", "bone surface", f"segment {name!r} has no points", "label it or drop it")
            centre[name] = bone.mean(0)
            front[name] = bone[bone[:, 1] <= np.quantile(bone[:, 1], 0.15)].mean(0)
            rear[name] = bone[bone[:, 1] >= np.quantile(bone[:, 1], 0.85)].mean(0)
            if role(name) == "proximal":
                hinge[name] = _condyle(bone)
            elif role(name) == UNCUT:
                left = bone[:, 0] > np.median(bone[:, 0])
                hinge[name] = 0.5 * (_condyle(bone[left]) + _condyle(bone[~left]))
        return cls(centre, hinge, front, rear)


def _condyle(ramus: np.ndarray) -> np.ndarray:
    """Middle (3,) of the condyle: the hind half of the top of a ramus, or of one side of a mandible, points (r, 3)."""
    top = ramus[ramus[:, 2] >= np.quantile(ramus[:, 2], 0.85)]
    return top[top[:, 1] >= np.median(top[:, 1])].mean(0)


def motion(angles, shift, pivot) -> RigidMotion:
    """From (pitch, roll, yaw) degrees and a shift to the (left, forward, up) in mm."""
    return RigidMotion.from_degrees(angles, np.asarray(shift, float) * [1, -1, 1], pivot)


def composed(after: RigidMotion, before: RigidMotion, pivot: np.ndarray) -> RigidMotion:
    """The motion after(before(x)), written about `pivot`."""
    moved = after.apply(before.apply(pivot[None]))[0]
    return RigidMotion(after.rotation @ before.rotation, moved - pivot, np.asarray(pivot, float))


def limited(move: RigidMotion, shift_limits: np.ndarray, angle_limits: np.ndarray) -> RigidMotion:
    """The largest fraction of the motion that keeps within the limits (left, forward, up; pitch, roll, yaw)."""
    shift = move.translation * [1, -1, 1]
    angles = Rotation.from_matrix(move.rotation).as_rotvec(degrees=True)
    bound = np.where(shift > 0, shift_limits[:, 1], -shift_limits[:, 0])
    excess = max(np.max(np.abs(shift) / bound), np.max(np.abs(angles) / angle_limits))
    return move if excess <= 1 else move.fraction((1 - 1e-9) / excess)


def proximal_motion(rng: np.random.Generator, anatomy: JawAnatomy, name: str, distal: RigidMotion) -> RigidMotion:
    """Small turn about the condyle that lets the ramus follow part of the distal segment's motion beside it.

    Sideways and vertical motion turn the ramus (yaw, pitch); it slides along front-to-back motion, and turns as the
    surgeon seats it. At most PROXIMAL_SHIFT at the centroid and PROXIMAL_ANGLE; the followed share FOLLOWED +- 0.1 is
    a choice [I].
    """
    share = truncated(rng, FOLLOWED, 0.1, 0.1, 0.7)
    turn = [truncated(rng, 0, sd, -2 * sd, 2 * sd) for sd in PROXIMAL_SCATTER]
    shift = np.array([truncated(rng, 0, 0.3, -0.8, 0.8) for _ in range(3)])
    return _about_condyle(anatomy, name, distal, share, turn, shift)


def ramus_following(anatomy: JawAnatomy, name: str, distal: RigidMotion) -> RigidMotion:
    """As :func:`proximal_motion` without its scatter: the usual turn about the condyle."""
    return _about_condyle(anatomy, name, distal, FOLLOWED, np.zeros(3), np.zeros(3))


def _about_condyle(anatomy: JawAnatomy, name: str, distal: RigidMotion, share: float, turn, shift) -> RigidMotion:
    """Turn of a ramus that follows a share of the distal motion, and a further one (degrees), and a shift (mm)."""
    hinge, front = anatomy.hinge[name], anatomy.front[name]
    arm = front - hinge
    target = share * distal.displacement(front[None])[0] * [1, 0, 1]
    # Least rotation whose velocity at `front` is nearest to the target.
    turn = np.degrees(np.cross(arm, target) / (arm @ arm)) + turn
    move = RigidMotion.from_degrees(turn, shift, hinge)
    travel = np.linalg.norm(move.displacement(anatomy.centre[name][None])[0])
    excess = max(travel / PROXIMAL_SHIFT, np.linalg.norm(turn) / PROXIMAL_ANGLE)
    return move if excess <= 1 else move.fraction(0.98 / excess)


def autorotation(anatomy: JawAnatomy, name: str, degrees: float) -> RigidMotion:
    """Turn of an uncut mandible about the axis through its condyles, AUTOROTATION at most; positive opens."""
    turned = float(np.clip(degrees, -AUTOROTATION, AUTOROTATION))
    return RigidMotion.from_degrees((turned, 0, 0), np.zeros(3), anatomy.hinge[name])


def raising(anatomy: JawAnatomy, name: str, rise: float) -> RigidMotion:
    """The autorotation that takes the front of an uncut mandible up by `rise` mm."""
    arm = anatomy.hinge[name][1] - anatomy.front[name][1]
    return autorotation(anatomy, name, -np.degrees(np.arcsin(np.clip(rise / arm, -1, 1))))


def segmental_motions(
    rng: np.random.Generator, anatomy: JawAnatomy, pieces: Sequence[str], jaw: RigidMotion
) -> dict[str, RigidMotion]:
    """Motions of the pieces of a maxilla: that of the whole, after small ones against each other.

    Left and right part by WIDENING mm between their hind ends: beside a front piece they shift sideways, without one
    they turn about their front ends, where they stay together. Every piece turns a little by itself.
    """
    if len(pieces) == 1:
        return {pieces[0]: jaw}
    middle = np.mean([anatomy.centre[name] for name in pieces], 0)
    front = any(FRONT in name for name in pieces)
    wider = truncated(rng, *WIDENING)
    motions = {}
    for name in pieces:
        angles = np.array([truncated(rng, *PIECE_TURN) for _ in range(3)])
        shift, pivot = np.zeros(3), anatomy.front[name]
        if FRONT in name:
            shift[2] = truncated(rng, *PIECE_SHIFT)
        else:
            side = np.sign(anatomy.centre[name][0] - middle[0])
            if front:
                shift[0] = side * wider / 2
            else:
                pivot = np.array([middle[0], *pivot[1:]])
                length = anatomy.rear[name][1] - pivot[1]
                angles[2] = -side * np.degrees(np.arctan(wider / 2 / length))
        relative = RigidMotion.from_degrees(angles, shift, pivot)
        motions[name] = composed(jaw, relative, anatomy.centre[name])
    return motions


def compose_plan(
    rng: np.random.Generator,
    case: str,
    anatomy: JawAnatomy,
    maxilla: RigidMotion,
    bite: RigidMotion,
    chin_advance: float | None = None,
    turn: float | None = None,
) -> Plan:
    """Plan of the segments in `anatomy` from the maxilla's motion and the correction of the bite before it.

    The correction moves the lower jaw against the upper; both motions are cut back to :data:`LIMITS`. A maxilla that is
    not cut stays, and the lower jaw goes to it. turn (degrees about the condyles): of an uncut mandible; by default it
    follows the upward motion of maxilla and correction.
    """
    roles = {name: role(name) for name in anatomy.centre}
    motions: dict[str, RigidMotion] = {}
    upper = [name for name in roles if roles[name] == "maxilla"]
    lower = [name for name in roles if roles[name] == "distal"]
    jaw, share = RigidMotion(), 1.0
    if upper:
        pivot = np.mean([anatomy.centre[name] for name in upper], 0)
        jaw = limited(composed(maxilla, RigidMotion(), pivot), *LIMITS["maxilla"])
    pivot = np.mean([anatomy.centre[name] for name in lower or roles], 0)
    distal = RigidMotion(pivot=pivot)
    if lower:
        # The bite comes first: where both jaws together would go too far, the upper one goes less far.
        for share in np.linspace(1, 0, 11):
            wanted = composed(jaw.fraction(share), bite, pivot)
            distal = limited(wanted, *LIMITS["distal"])
            if distal is wanted:
                break
        motions |= dict.fromkeys(lower, distal)
    elif UNCUT in roles:
        if turn is None:
            wanted = composed(jaw, bite, anatomy.front[UNCUT])
            distal = raising(anatomy, UNCUT, wanted.translation[2])
        else:
            distal = autorotation(anatomy, UNCUT, turn)
        motions[UNCUT] = distal
    if upper:
        motions |= segmental_motions(rng, anatomy, upper, jaw.fraction(share))
    for name in (name for name in roles if roles[name] == "chin"):
        advance = truncated(rng, *CHIN_ADVANCE) if chin_advance is None else chin_advance
        motions[name] = composed(RigidMotion(translation=np.array([0.0, -advance, 0])), distal, anatomy.centre[name])
    for name in (name for name in roles if roles[name] == "proximal"):
        motions[name] = proximal_motion(rng, anatomy, name, distal)
    return Plan(case, motions)


def sample_maxilla(rng: np.random.Generator, deformity: str, pivot: np.ndarray, spread: float = 1.0) -> RigidMotion:
    """Motion of the Le Fort I segment that is usual for a deformity.

    `spread` scales what has no usual direction: the midline shift and the turns.
    """
    forward, up = (truncated(rng, *numbers) for numbers in MAXILLA[deformity])
    left = truncated(rng, 0, 1.5, -5, 5)
    angles = [truncated(rng, 0, *numbers) for numbers in ((3, -10, 10), (1.5, -6, 6), (1.5, -6, 6))]
    return motion(spread * np.array(angles), (spread * left, forward, up), pivot)


def sample_plan(
    rng: np.random.Generator,
    case: str,
    segments: tuple[str, ...],
    points: np.ndarray,
    segment: np.ndarray,
    deformity: str | None = None,
    scale: float = 1.0,
) -> Plan:
    """A plausible plan for a patient of whom only bone points are known.

    points (b, 3) mm with segment index (b,), -1 ignored; segments: any subset of jaw pieces.
    deformity: one of :data:`DEFORMITIES`, or None to draw one; scale multiplies the
    sampled magnitudes before the limits apply.
    """
    if deformity is None:
        deformity = DEFORMITIES[rng.integers(len(DEFORMITIES))]
    anatomy = JawAnatomy.from_points(points, segment, tuple(segments))
    pivots = list(anatomy.centre.values())
    upper = [anatomy.centre[name] for name in segments if role(name) == "maxilla"] or pivots
    lower = [anatomy.centre[name] for name in segments if role(name) in ("distal", UNCUT)] or pivots
    maxilla = sample_maxilla(rng, deformity, np.mean(upper, 0))
    forward, midline, closing = (truncated(rng, *numbers) for numbers in BITE[deformity])
    side = 1.0 if rng.random() < 0.5 else -1.0
    # Closing by `closing` mm at the incisors turns the jaw about the molars, some 45 mm behind; a midline shift
    # comes with a yaw about the condyles, some 75 mm behind.
    pitch = -np.degrees(closing / 45.0) + truncated(rng, 0, 0.8, -2, 2)
    yaw = np.degrees(0.7 * side * midline / 75.0) + truncated(rng, 0, 0.5, -1.5, 1.5)
    roll = truncated(rng, 0, 1.0, -3, 3)
    bite = motion((pitch, roll, yaw), (side * midline, forward, 0.5 * closing), np.mean(lower, 0))
    chin = truncated(rng, *CHIN_ADVANCE)
    return compose_plan(rng, case, anatomy, maxilla.fraction(scale), bite.fraction(scale), scale * chin)


def execution_error(plan: Plan, rng: np.random.Generator, scale: float = 1.0) -> Plan:
    """The plan as carried out: each motion with a random error of published size [S: PMC8432567] times `scale`.

    Absolute errors are gamma variables of the published mean and SD with a random sign. Proximal segments, which the
    surgeon seats by hand about the condyle, and an uncut mandible, which stays in its joints, take half of it [I]. The
    pieces of a maxilla share one error and take PIECE_ERROR of it each by themselves.
    """
    carried, common = {}, None
    pieces = of_role(list(plan.motions), "maxilla")
    for name, move in sorted(plan.motions.items()):
        mean, sd = EXECUTION.T
        size = rng.gamma((mean / sd) ** 2, sd**2 / mean) * rng.choice([-1.0, 1.0], 6)
        if len(pieces) > 1 and name in pieces:
            common = size if common is None else common
            size = common + PIECE_ERROR * (size - common)
        size *= scale * (0.5 if role(name) in ("proximal", UNCUT) else 1.0)
        turned = Rotation.from_rotvec(size[3:], degrees=True).as_matrix() @ move.rotation
        carried[name] = RigidMotion(turned, move.translation + size[:3], move.pivot)
    return Plan(plan.case, carried)
