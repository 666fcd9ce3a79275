"""Cephalometric landmarks of the bone at the midline, each carried by its segment, and what surgeons read off them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinnochio.errors import InputError
from pinnochio.model.bones import of_segments, places
from pinnochio.model.landmarks import SEEN, STEP, farthest, off_chord, section, upper_jaw
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT

BESIDE = (-4.0, -2.0, 0.0, 2.0, 4.0)  # mm from the midline: sections whose foremost counts, as in a film [I]
FRONT, DEEP = 10.0, 20.0  # mm beside the midline and behind the front of a jaw: its incisors and chin [I]
CREST, SPINE = (6.0, 14.0), (20.0, 36.0)  # mm from the incisors' edge: alveolar crest, anterior nasal spine [R]
CHIN = 20.0  # mm above menton within which pogonion lies [I]
BROW = 10.0  # mm above the nasal root at least [I]
GLABELLA, BRIDGE, ROOT = 35.0, 25.0, 30.0  # mm above, below and behind the skin of the nasal root: its bone [I]


@dataclass(frozen=True)
class BoneLandmarks:
    """By name (N, ANS, A, U1, L1, B, Pog, Me, Go) points (k, 3) mm LPS whose mean is the landmark, and the segment that
    carries each, "" for the cranium; what cannot be read is left out."""

    points: Mapping[str, tuple[np.ndarray, tuple[str, ...]]]

    def under(self, plan: Plan) -> dict[str, np.ndarray]:
        """Place (3,) mm of each landmark under a plan."""
        moved = {}
        for name, (points, carriers) in self.points.items():
            ways = [plan.motion(one).apply(p[None])[0] if one else p for p, one in zip(points, carriers, strict=True)]
            moved[name] = np.mean(ways, axis=0)
        return moved


def bone_landmarks(patient: PatientModel, middle: float, sellion: np.ndarray) -> BoneLandmarks:
    """Landmarks on the foremost outline about the midline x (mm), in the profile of an upright face.

    U1, L1: edges of the incisors. ANS: foremost at the height of the spine; A: deepest behind the chord from ANS to the
    alveolar crest. Me: lowest of the chin, Pog: its foremost; B: deepest behind the chord from Pog to the crest. N:
    deepest behind the chord from the glabella to the nasal bones, near the skin's sellion (3,) mm. Go: corners of both
    jaw angles. A and B of bone without a hollow, and ANS of bone without a spine, are places of about their height. A
    root of the nose without a hollow is none; without a foremost place, Pog is farthest in front of the chord from Me
    to the crest, or left out with B.
    """
    lower = of_segments(patient.bone_segment, patient.segments, "distal", UNCUT, "chin")
    upper, height = upper_jaw(patient), patient.bone_points[:, 2]
    if (patient.bone_segment[upper] < 0).any():  # a maxilla that is not cut: up to its spine
        edge = height[upper].min()
        upper = (patient.bone_segment < 0) & (height >= edge) & (height < edge + SPINE[1])
    jaws = [mask & _front(patient.bone_points, mask, middle) for mask in (upper, lower)]
    heights = [patient.bone_points[jaw, 2] for jaw in jaws]
    points: dict[str, tuple[np.ndarray, tuple[str, ...]]] = {}

    def read(mask: np.ndarray, low: float, high: float, rule) -> None:
        """Landmarks of a rule(line (k, 2) depth and height, at(height) -> index) of a bone between two heights."""
        try:
            z = np.arange(low, high, STEP)
            line = np.column_stack([_foremost(patient, mask, middle, z), z])
            marks = rule(line, lambda height: int(np.clip(round((height - low) / STEP), 0, len(z) - 1)))
        except (InputError, ValueError, IndexError):  # the scan does not show it
            return
        for name, index in marks.items():
            place = np.array([middle, *line[index]])
            nearest = np.where(mask, np.linalg.norm(patient.bone_points - place, axis=1), np.inf).argmin()
            points[name] = place[None], (_carrier(patient, nearest),)

    def fold(line, start: int, end: int) -> int:
        """The deepest place between two; half-way where the bone has no hollow there."""
        deepest = farthest(line, start, end, False)
        return deepest if deepest not in (start, end) else (start + end) // 2

    def upper_rule(line, at):
        edge = line[0, 1]
        spine = _foremost_of(line, at(edge + SPINE[0]), at(edge + SPINE[1]))
        crest = _foremost_of(line, at(edge + CREST[0]), at(edge + CREST[1]))
        return {"U1": 0, "ANS": spine, "A": fold(line, crest, spine)}

    def lower_rule(line, at):
        top = len(line) - 1
        chin = _foremost_of(line, 0, at(line[0, 1] + CHIN))
        crest = _foremost_of(line, at(line[top, 1] - CREST[1]), at(line[top, 1] - CREST[0]))
        end = at(line[0, 1] + CHIN)
        if chin == end:  # a chin that recedes, or a head that is bent
            chin = farthest(line, 0, crest, True, 0, end)
            if chin == end or off_chord(line, 0, crest, chin) > -SEEN:
                return {"Me": 0, "L1": top}
        return {"Me": 0, "Pog": chin, "L1": top, "B": fold(line, chin, crest)}

    def root_rule(line, at):
        root = at(sellion[2])
        bridge, brow = _foremost_of(line, 0, root), _foremost_of(line, at(sellion[2] + BROW), len(line) - 1)
        deepest = farthest(line, bridge, brow, False)
        seen = off_chord(line, bridge, brow, deepest) > SEEN
        return {"N": deepest} if seen and 0 < line[deepest, 0] - sellion[1] < ROOT else {}

    if len(heights[0]):
        read(jaws[0], heights[0].min(), heights[0].max(), upper_rule)
    if len(heights[1]):
        read(jaws[1], heights[1].min(), heights[1].max(), lower_rule)
    read(patient.bone_segment < 0, sellion[2] - BRIDGE, sellion[2] + GLABELLA, root_rule)
    angles = places(patient)
    angles = [angles[f"gonion_{side}"] for side in ("right", "left")]
    if all(map(len, angles)):
        at = [rows[(patient.bone_points[rows] @ [0, 1, -1]).argmax()] for rows in angles]
        points["Go"] = patient.bone_points[at], tuple(_carrier(patient, row) for row in at)
    return BoneLandmarks(points)


# By name title, unit and what a larger value means.
BONE_MEASURES = {
    "bone_anb": ("ANB", "degree", "A in front of B"),
    "bone_convexity": ("N-A-Pog", "degree", "more convex"),
    "bone_a": ("A to the vertical through N", "mm", "in front"),
    "bone_b": ("B to the vertical through N", "mm", "in front"),
    "bone_pog": ("Pog to the vertical through N", "mm", "in front"),
    "bone_overjet": ("Overjet", "mm", "upper incisors in front"),
    "bone_overbite": ("Overbite", "mm", "deeper"),
    "bone_mandibular_plane": ("Me-Go to the horizontal", "degree", "steeper"),
}


def bone_measures(at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Values (m,) of BONE_MEASURES by the places (3,) mm of landmarks; NaN where one that is read is unknown."""
    names = ("N", "A", "B", "Pog", "Me", "Go", "U1", "L1")
    n, a, b, chin, menton, angle, upper, lower = (at.get(name, np.full(3, np.nan)) for name in names)

    def swing(arm) -> float:
        """Degrees by which an arm (3,) that points down reaches forward."""
        return np.degrees(np.arctan2(-arm[1], -arm[2]))

    angles = swing(a - n) - swing(b - n), swing(a - n) - swing(chin - a)
    plane = np.degrees(np.arctan2(*(angle - menton)[[2, 1]]))
    return np.array([*angles, *(n - [a, b, chin])[:, 1], *(lower - upper)[1:], plane])


def _front(points: np.ndarray, mask: np.ndarray, middle: float) -> np.ndarray:
    """Which bone points (b,) are at the middle of the front of those of a mask (b,)."""
    central = np.abs(points[:, 0] - middle) < FRONT
    return central & (points[:, 1] < points[mask & central, 1].min(initial=np.inf) + DEEP)


def _foremost(patient: PatientModel, mask: np.ndarray, middle: float, z: np.ndarray) -> np.ndarray:
    """Foremost y (k,) mm about the midline at heights z of the bone of a mask (b,); InputError without any."""
    points, faces = patient.bone_points, patient.bone_faces[mask[patient.bone_faces].all(axis=1)]
    return np.min([section(points, faces, points[:, 0] - middle - off, points[:, 2], z) for off in BESIDE], axis=0)


def _foremost_of(line: np.ndarray, first: int, last: int) -> int:
    return first + int(line[first : last + 1, 0].argmin())


def _carrier(patient: PatientModel, point: int) -> str:
    segment = patient.bone_segment[point]
    return patient.segments[segment] if segment >= 0 else ""
