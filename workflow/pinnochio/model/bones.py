"""Where the parts of a patient's skeleton lie, whichever of them are cut."""

from collections.abc import Mapping, Sequence

import numpy as np

from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, known_role

TEETH = 12.0  # mm above and 8 mm before the edge of the lower teeth: the upper teeth and their bone [I]
OVERJET = 8.0
FRONT, REAR = 20.0, 25.0  # mm from the foremost and the hindmost point of the lower jaw: its chin, its angles [I]
END = 10.0  # mm: depth of an end of a bone [I]
LATERAL = 0.6  # of the lower jaw's half width: its angles lie further out [I]
PLACES = ("upper_incisors", "upper_molars_left", "upper_molars_right", "lower_incisors", "chin", "gonion_left",
          "gonion_right")  # fmt: skip


def of_segments(segment: np.ndarray, segments: Sequence[str], *roles: str) -> np.ndarray:
    """Which bone points, with segment index (b,), belong to segments of these roles: (b,) bool."""
    return np.isin(segment, [i for i, name in enumerate(segments) if known_role(name) in roles])


def segment_points(model: PatientModel) -> dict[str, np.ndarray]:
    """Bone points (b, 3) mm of every segment, by its name."""
    return {name: model.bone_points[model.bone_segment == index] for index, name in enumerate(model.segments)}


def nasion_height(points: np.ndarray, segment: np.ndarray, segments: Sequence[str], above_maxilla: float) -> float:
    """Height z (mm) that stands for the nasion's; infinite without bone.

    points (b, 3) mm, segment (b,) index, -1 the cranium. `above_maxilla` (mm) above the top of the maxilla's segments;
    where the maxilla is not cut, the top of the condyles, which is as high on the virtual heads [X]; without either,
    above the top of all segments.
    """
    for roles, above in ((("maxilla",), above_maxilla), (("proximal", UNCUT), 0.0)):
        of_roles = of_segments(segment, segments, *roles)
        if of_roles.any():
            return float(points[of_roles, 2].max()) + above
    return float(points[segment >= 0, 2].max(initial=-np.inf)) + above_maxilla if (segment >= 0).any() else np.inf


def above_teeth(points: np.ndarray, segment: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Points (b,) bool of the cranium that stand for an uncut upper jaw: about and above the edge of the lower teeth.

    points (b, 3) mm, segment (b,) index, lower (b,) bool the tooth-bearing lower jaw.
    """
    jaw = points[lower]
    front = jaw[jaw[:, 1] < jaw[:, 1].min() + END]
    edge, face = front[:, 2].max(), front[:, 1].min()
    wide = jaw[:, 0].min(), jaw[:, 0].max()
    upper = (segment == -1) & (np.abs(points[:, 2] - edge) < TEETH) & (points[:, 1] > face - OVERJET)
    return upper & (points[:, 0] > wide[0]) & (points[:, 0] < wide[1]) & (points[:, 1] < np.median(jaw[:, 1]))


def places(model: PatientModel) -> dict[str, np.ndarray]:
    """Bone points (k,) by the names of PLACES, of what a plan can move; none where that bone is not cut.

    The same places of the skeleton in every case, however it is cut: of the maxilla the foremost and the hindmost
    part of its lower half, left and right; of the lower jaw's body the foremost upper and the foremost lower part; of
    all that reaches to the condyles, left and right, the lowest part behind.
    """
    points, indices = model.bone_points, dict.fromkeys(PLACES, np.zeros(0, int))
    upper, body, rear = (
        np.flatnonzero(of_segments(model.bone_segment, model.segments, *roles))
        for roles in (("maxilla",), ("distal", UNCUT, "chin"), ("proximal", UNCUT))
    )
    if len(upper):
        low = upper[points[upper, 2] <= np.median(points[upper, 2])]
        indices["upper_incisors"] = _end(points, low, 1, -1)
        behind = _end(points, low, 1, 1)
        indices |= _sides("upper_molars", points, behind, points[low, 0])
    if len(body):
        indices["lower_incisors"] = _end(points, _end(points, body, 1, -1), 2, 1)
        indices["chin"] = _end(points, _end(points, body, 1, -1, FRONT), 2, -1)
    if len(rear := rear if len(rear) else body):
        behind = _end(points, rear, 1, 1, REAR)
        across = points[rear, 0] - 0.5 * (points[rear, 0].min() + points[rear, 0].max())
        lateral = rear[np.abs(across) > LATERAL * np.abs(across).max()]
        behind = np.intersect1d(behind, lateral)
        for side, corner in _sides("gonion", points, behind, points[rear, 0]).items():
            indices[side] = _end(points, corner, 2, -1)
    return indices


def motion_of_places(model: PatientModel, plan: Plan) -> Mapping[str, np.ndarray]:
    """Mean displacement (3,) mm of each of the places under a plan, by the names of PLACES; zero where none is cut."""
    moved = model.bone_displacement(plan)
    return {name: moved[rows].mean(axis=0) if len(rows) else np.zeros(3) for name, rows in places(model).items()}


def _end(points: np.ndarray, indices: np.ndarray, axis: int, sign: int, depth: float = END) -> np.ndarray:
    """Those of the points `indices` (k,) that are within `depth` mm of the farthest along an axis."""
    along = sign * points[indices, axis]
    return indices[along >= along.max(initial=-np.inf) - depth]


def _sides(name: str, points: np.ndarray, indices: np.ndarray, across: np.ndarray) -> dict[str, np.ndarray]:
    """The points left and right (LPS: +x is left) of the middle of all x of a bone, across (k,)."""
    middle = 0.5 * (across.min() + across.max())
    left = points[indices, 0] > middle
    return {f"{name}_left": indices[left], f"{name}_right": indices[~left]}
