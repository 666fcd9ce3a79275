"""Motions as surgeons say them: advance or set back, impact or lengthen, to a side; pitch, roll and yaw."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.roles import known_role

# A pivot farther from the middle of its bone than this says nothing to a person who turns the bone, mm.
FARTHEST_PIVOT = 100.0
SAID = 0.05  # mm or degrees from which a part of a motion is worth a word


@dataclass(frozen=True)
class Amount:
    """A part of a motion. unit: mm or °; axis of the frame and its sign; more, less: what a positive and a negative
    amount do; done: the same of a motion that is planned."""

    unit: str
    axis: int
    sign: int
    more: str
    less: str
    done: tuple[str, str]


# Translation of the pivot, then the rotation vector. LPS: x to the left, y backwards, z up.
AMOUNTS: Mapping[str, Amount] = {
    "advance": Amount("mm", 1, -1, "advance", "set back", ("advanced", "set back")),
    "up": Amount("mm", 2, 1, "up", "down", ("up", "down")),
    "left": Amount("mm", 0, 1, "to the left", "to the right", ("to the left", "to the right")),
    "yaw": Amount("°", 2, 1, "front to the left", "front to the right", ("front to the left", "front to the right")),
    "roll": Amount("°", 1, 1, "left side down", "left side up", ("left side down", "left side up")),
    "pitch": Amount("°", 0, 1, "front down", "front up", ("front down", "front up")),
}
# What up and down are called of some bones.
VERTICAL = {"maxilla": ("impact", "lengthen", ("impacted", "lengthened")),
            "chin": ("shorten", "lengthen", ("shortened", "lengthened"))}  # fmt: skip


def amount(name: str, segment: str) -> Amount:
    """One of AMOUNTS in the words for a segment."""
    part = AMOUNTS[name]
    words = VERTICAL.get(known_role(segment)) if name == "up" else None
    return Amount(part.unit, part.axis, part.sign, *words) if words else part


def amounts(motion: RigidMotion) -> dict[str, float]:
    """Parts of a motion by the names of AMOUNTS: mm of its pivot, degrees of its rotation vector."""
    parts = {"mm": motion.translation, "°": motion.degrees}
    return {name: float(part.sign * parts[part.unit][part.axis]) for name, part in AMOUNTS.items()}


def motion_of(parts: Mapping[str, float], pivot: np.ndarray) -> RigidMotion:
    """The motion (mm LPS) that has these :func:`amounts`."""
    turned = {"mm": np.zeros(3), "°": np.zeros(3)}
    for name, part in AMOUNTS.items():
        turned[part.unit][part.axis] = part.sign * parts[name]
    return RigidMotion.from_degrees(turned["°"], turned["mm"], pivot)


def near_bone(motion: RigidMotion, middle: np.ndarray) -> RigidMotion:
    """The same motion about its own pivot or, if that is far from the middle (3,) mm of the bone, about the middle."""
    return motion.about(middle) if np.linalg.norm(motion.pivot - middle) > FARTHEST_PIVOT else motion


def segment_in_words(name: str) -> str:
    """A segment as people write it, such as "Le Fort I front" or "mandible distal"."""
    return name.replace("_", " ").replace("lefort1", "Le Fort I")


def in_words(motion: RigidMotion, segment: str) -> str:
    """A motion of a segment in words, such as "advanced 5.0 mm, impacted 2.0 mm, yaw 1.0° (front to the left)"."""
    said = []
    for name, value in amounts(motion).items():
        part = amount(name, segment)
        if abs(value) < SAID:
            continue
        word = part.done[value < 0]
        if part.unit == "°":
            said.append(f"{name} {abs(value):.1f}° ({word})")
        else:
            said.append(f"{word} {abs(value):.1f} mm" if name != "left" else f"{abs(value):.1f} mm {word}")
    return ", ".join(said) or "not moved"
