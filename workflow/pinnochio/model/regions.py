"""Regions of the skin as a surgeon draws them: nose, lips, chin, cheeks, what is left, and the neck below the jaw."""

import numpy as np

from pinnochio.geometry.closest_points import closest_points
from pinnochio.model import patient as m
from pinnochio.model.bones import of_segments
from pinnochio.model.landmarks import CHIN as FRONT
from pinnochio.model.landmarks import FaceLandmarks, face_landmarks
from pinnochio.plans.roles import UNCUT

NAMES = ("nose", "upper_lip", "lower_lip", "chin", "cheek_right", "cheek_left", "other", "neck")
NOSE, UPPER_LIP, LOWER_LIP, CHIN, CHEEK_RIGHT, CHEEK_LEFT, OTHER, NECK = range(len(NAMES))
NOT_JUDGED = -1
ROOT = 0.5  # width of the nose at its root by that at its wings [I]
GROOVE = 1.5  # mm from a wing of the nose to the groove around it [I]
SLIT = 5.0  # mm about stomion within which the free sides of the lips lie [I]
FOLD = 5.0  # mm from a corner of the mouth outward to the fold of the cheek [I]
RIM = 0.6  # height of the lower rim of the orbit, from subnasale (0) to sellion (1) [I]
BEHIND = 15.0  # mm behind menton: where the chin's front ends at its sides [I]
UNDER = 0.6  # slope from the bone to the skin beyond which that lies under the jaw: 30 degrees [I]
ANGLE = 35.0  # mm behind the chin's lower end and LATERAL mm beside it: the border of the jaw towards its angle [I]
LATERAL = 20.0
RISES = 5.0, 45.0  # degrees by which the border of a jaw rises to the back [R: 15 to 40]
BELOW = 5.0  # mm about the chin's lower end within which the skin below it is sought [I]
PAD = 8.0  # mm of soft tissue below the chin where no skin is there [R]


def regions(patient: m.PatientModel) -> np.ndarray:
    """Region (s,) int8 of every skin point: an index into NAMES on the face, NOT_JUDGED elsewhere.

    NECK is the face's skin below the plane of :func:`jaw_plane`: shown, but not counted.
    Raises InputError where the face cannot be read (:mod:`pinnochio.model.landmarks`).
    """
    judged = patient.judged_points
    carriers = patient.lip[patient.skin_nodes[judged]]
    upper, lower = ((carriers == lip).any(axis=1) for lip in (m.UPPER_LIP, m.LOWER_LIP))
    lip = np.select([upper & ~lower, lower & ~upper], [m.UPPER_LIP, m.LOWER_LIP], m.NOT_LIP)
    points, marks = patient.skin_points[judged], face_landmarks(patient)
    region = divide(points, lip, marks, patient.bone_points, patient.bone_faces)
    menton, down = jaw_plane(patient, marks)
    region[(points - menton) @ down > 0] = NECK
    codes = np.full(len(patient.skin_points), NOT_JUDGED, np.int8)
    codes[judged] = region
    return codes


def jaw_plane(patient: m.PatientModel, marks: FaceLandmarks) -> tuple[np.ndarray, np.ndarray]:
    """Soft-tissue menton (3,) mm and the unit normal (3,), downward, of the plane through it along the jaw's border.

    The plane is parallel to the one that touches the bone of the lower jaw at menton, the chin's lower end, and from
    below towards both angles: the mandibular plane of cephalometry. Soft-tissue menton is the skin straight below the
    bone's [R: Legan and Burstone 1980]. What lies below is the neck: so the line of the jaw, with the tissue that
    hangs about its border, is judged, and the judged skin ends neither where a scan happens to end nor in a fold of
    the neck [I].
    """
    roles = of_segments(patient.bone_segment, patient.segments, "distal", UNCUT, "proximal", "chin")
    bone = patient.bone_points[roles if roles.any() else patient.bone_points[:, 2] < marks.stomion[2]]
    x = marks.menton[0]
    front = bone[np.abs(bone[:, 0] - x) < LATERAL]
    front = front[front[:, 1] < front[:, 1].min(initial=np.inf) + FRONT]
    if not len(front):
        return marks.menton - [0, 0, PAD], np.array([0.0, 0.0, -1.0])
    menton = np.array([x, *front[front[:, 2].argmin(), 1:]])
    slopes = []
    for side in (-1, 1):
        away = bone[(bone[:, 1] > menton[1] + ANGLE) & (side * (bone[:, 0] - x) > LATERAL)] - menton
        slopes.append((away[:, 2] / away[:, 1]).min(initial=np.inf))
    rise = np.tan(np.radians(np.clip(np.degrees(np.arctan(np.mean(slopes))), *RISES)))
    skin = patient.skin_points[np.unique(patient.skin_faces)]
    near = skin[(np.hypot(*(skin - menton)[:, :2].T) < BELOW) & (skin[:, 2] < menton[2])]
    soft = menton - [0, 0, menton[2] - near[:, 2].max() if len(near) else PAD]
    down = np.array([0.0, rise, -1.0])
    return soft, down / np.linalg.norm(down)


def divide(points, lip, marks: FaceLandmarks, bone_points, bone_faces) -> np.ndarray:
    """Region (k,) int8 of points (k, 3) mm of a face with these landmarks over this bone (points, faces).

    lip (k,): the lip whose free side a point lies on; counts near the height of stomion, which parts all other points.

    nose    above the plane through subnasale that halves the nasolabial angle, below sellion, between the grooves
            beside the wings, and narrower towards the root
    lips    below that plane and above sublabiale, parted at stomion; as wide as the nose above, at the mouth as far as
            the folds beside its corners, below as wide as the mouth
    chin    below sublabiale, as wide as the mouth, about the chin's own middle; its front down to the bone's lower end
    cheeks  what is left below the rim of the orbit
    other   what is left above it, and the skin under the jaw, where the way from the bone leads down rather than out
    """
    points = np.asarray(points, float)
    x, y, z = points.T
    heights = [marks.menton[2], marks.pogonion[2], marks.stomion[2]]
    side = x - np.interp(z, heights, [marks.menton[0], marks.pogonion[0], marks.stomion[0]])
    left = side > 0
    # Half the width of nose and mouth, right and left.
    wings, corners = (np.abs(pair[:, 0] - marks.stomion[0]) for pair in (marks.alare, marks.cheilion))

    def between(levels, widths) -> np.ndarray:
        """Whether each point lies nearer to the midline than the widths (right, left) at the rising levels."""
        right_left = [np.interp(z, levels, [pair[i] for pair in widths]) for i in (0, 1)]
        return np.abs(side) < np.where(left, *reversed(right_left))

    nasal = between([marks.pronasale[2], marks.sellion[2]], [wings + GROOVE, ROOT * wings])
    levels = [marks.sublabiale[2], marks.stomion[2], marks.subnasale[2]]
    oral = between(levels, [corners, corners + FOLD, wings + GROOVE])

    up, down = (marks.pronasale - marks.subnasale)[1:], (marks.labrale_superius - marks.subnasale)[1:]
    ahead = up / np.linalg.norm(up) + down / np.linalg.norm(down)
    above = ahead[1] * (y - marks.subnasale[1]) > ahead[0] * (z - marks.subnasale[2])
    jaw = bone_faces[(bone_points[bone_faces, 2] < marks.stomion[2]).all(axis=1)]
    way = points - closest_points(points, bone_points, jaw).points
    out = np.hypot(np.maximum(way[:, 0] * np.where(left, 1, -1), 0), np.minimum(way[:, 1], 0))
    under = (z < marks.stomion[2]) & (-way[:, 2] > UNDER * out)
    known = (lip != m.NOT_LIP) & (np.abs(z - marks.stomion[2]) < SLIT)
    upper = np.where(known, lip == m.UPPER_LIP, z >= marks.stomion[2])

    region = np.where(left, CHEEK_LEFT, CHEEK_RIGHT).astype(np.int8)
    region[under | (z > (1 - RIM) * marks.subnasale[2] + RIM * marks.sellion[2])] = OTHER
    region[nasal & above & (z < marks.sellion[2])] = NOSE
    front = (z > marks.menton[2]) & (y < marks.menton[1] + BEHIND)  # even where the bone of the chin recedes
    region[oral & ~above & (z < marks.sublabiale[2]) & (front | ~under)] = CHIN
    lips = oral & ~above & (z >= marks.sublabiale[2])
    region[lips & upper], region[lips & ~upper] = UPPER_LIP, LOWER_LIP
    return region
