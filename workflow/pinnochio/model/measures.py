"""The usual measures of a face's soft tissue: values with units, each with its derivatives by the landmarks."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

# Landmarks that the measures read. A' and B' are the deepest points of the upper lip's and the chin's fold; stomion is
# the edge of each lip.
LANDMARKS = (
    "sellion",
    "pronasale",
    "columella",
    "subnasale",
    "subspinale",
    "labrale_superius",
    "stomion_superius",
    "stomion_inferius",
    "labrale_inferius",
    "sublabiale",
    "pogonion",
    "menton",
    "alare_right",
    "alare_left",
)
SHORTEST = 3.0  # mm: two landmarks nearer than this show no angle, as B' and Pog' of a chin without a fold [I]
FORWARD, UP, LEFT = np.array([0.0, -1, 0]), np.array([0.0, 0, 1]), np.array([1.0, 0, 0])


@dataclass(frozen=True)
class Measure:
    """A number read off landmarks.

    title: as surgeons write it; unit: mm or degree; positive: what a larger value means; points: the landmarks that
    `rule` reads, in its order: rule(points (p, 3) mm LPS) -> value and its derivative (p, 3), unit per mm.
    """

    title: str
    unit: str
    positive: str
    points: tuple[str, ...]
    rule: Callable[[np.ndarray], tuple[float, np.ndarray]]


def _along(axis: np.ndarray) -> Callable:
    """Distance from the first point to the second along an axis (3,)."""
    return lambda points: (float(axis @ (points[1] - points[0])), np.array([-axis, axis]))


def _in_front(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Signed distance of the third point in front of the line from the first, above, to the second, in profile."""
    line, way = (points[1] - points[0])[1:], (points[2] - points[0])[1:]
    length = np.linalg.norm(line)
    across = np.array([line[1], -line[0]]) / length
    value = way @ across
    by_line = (np.array([-way[1], way[0]]) - value * line / length) / length
    gradient = np.zeros((3, 3))
    gradient[2, 1:], gradient[1, 1:] = across, by_line
    gradient[0] = -gradient[1] - gradient[2]
    return float(value), gradient


def _angle(points: np.ndarray) -> tuple[float, np.ndarray]:
    """Angle (0 to 360 degrees) at the second point from the first, above, to the third, through the air in front.

    NaN where two landmarks are nearer than SHORTEST.
    """
    arms = points[[0, 2], 1:] - points[1, 1:]
    if not (np.linalg.norm(arms, axis=1) >= SHORTEST).all():
        return np.nan, np.full((3, 3), np.nan)
    turns = np.arctan2(arms[:, 1], arms[:, 0])
    by_arm = np.column_stack([-arms[:, 1], arms[:, 0]]) / (arms**2).sum(axis=1)[:, None]
    gradient = np.zeros((3, 3))
    gradient[0, 1:], gradient[2, 1:] = -by_arm[0], by_arm[1]
    gradient[1] = -gradient[0] - gradient[2]
    return float(np.degrees((turns[1] - turns[0]) % (2 * np.pi))), np.degrees(gradient)


def _convexity(points: np.ndarray) -> tuple[float, np.ndarray]:
    value, gradient = _angle(points)
    return value - 180, gradient


# By name. The vertical and the midline through sellion move with it, which no operation on the jaws moves.
MEASURES: Mapping[str, Measure] = {
    "a_forward": Measure("A' to the vertical through N'", "mm", "in front", ("sellion", "subspinale"), _along(FORWARD)),
    "b_forward": Measure("B' to the vertical through N'", "mm", "in front", ("sellion", "sublabiale"), _along(FORWARD)),
    "pog_forward": Measure("Pog' to the vertical through N'", "mm", "in front", ("sellion", "pogonion"),
        _along(FORWARD)),
    "upper_lip_e_line": Measure("Upper lip to E-line", "mm", "in front", ("pronasale", "pogonion", "labrale_superius"),
        _in_front),
    "lower_lip_e_line": Measure("Lower lip to E-line", "mm", "in front", ("pronasale", "pogonion", "labrale_inferius"),
        _in_front),
    "nasolabial": Measure("Nasolabial angle", "degree", "more open", ("columella", "subnasale", "labrale_superius"),
        _angle),
    "mentolabial": Measure("Mentolabial angle", "degree", "more open", ("labrale_inferius", "sublabiale", "pogonion"),
        _angle),
    "convexity": Measure("Facial convexity (N'-Sn-Pog')", "degree", "more convex", ("sellion", "subnasale", "pogonion"),
        _convexity),
    "interlabial_gap": Measure("Interlabial gap", "mm", "lips apart", ("stomion_inferius", "stomion_superius"),
        _along(UP)),
    "alar_width": Measure("Alar width", "mm", "wider", ("alare_right", "alare_left"), _along(LEFT)),
    "midline": Measure("Upper lip to the facial midline", "mm", "to the left", ("sellion", "labrale_superius"),
        _along(LEFT)),
    "chin_asymmetry": Measure("Chin to the facial midline", "mm", "to the left", ("sellion", "pogonion"), _along(LEFT)),
}  # fmt: skip


def measure(positions: np.ndarray) -> np.ndarray:
    """Values (m,) of the MEASURES, in mm or degrees, of LANDMARKS at positions (k, 3) mm LPS of an upright face.

    NaN where a landmark that a measure reads is not known (NaN), and for an angle between landmarks that nearly meet.
    Lips that cross are in contact, as they are shown: no gap is below 0.
    """
    read = {name: np.asarray(positions, float)[[LANDMARKS.index(point) for point in item.points]]
            for name, item in MEASURES.items()}  # fmt: skip
    values = {name: MEASURES[name].rule(points)[0] for name, points in read.items()}
    return np.array(list((values | {"interlabial_gap": np.maximum(values["interlabial_gap"], 0.0)}).values()))
