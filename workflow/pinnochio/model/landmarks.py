"""Landmarks of a face, read off the middle profile of its skin and a section across its nose."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pinnochio.errors import InputError
from pinnochio.model.bones import above_teeth, of_segments
from pinnochio.model.patient import LOWER_LIP, UPPER_LIP, PatientModel
from pinnochio.plans.roles import UNCUT

STEP = 0.5  # mm between the points of a profile
TEETH = 15.0  # mm from the midline and behind the front of the upper jaw: its incisors [I]
SLIT = 8.0  # mm about the incisors' edge within which lips meet [I]
CHIN = 20.0  # mm of bone above its lower end and behind its front: the chin [I]
FOREHEAD = 95.0  # mm above the mouth: beyond any nasal root [I]
BRIDGE = 20.0  # mm by which the nasal root lies above the tip of the nose, at least [I]
CHEEK = 40.0  # mm from the midline: beyond any nose and any corner of a mouth [I]
WING = (12.0, 24.0)  # mm: half the width of a nose [R: noses of adults are 30 to 42 mm wide]
MOUTH = 1.5  # width of a mouth by that of the nose, the neoclassical canon [R: Farkas]
WIDEST = 30.0  # mm: half the width of any mouth [R: mouths of adults are 45 to 60 mm wide]
SHORTEST_LIP = 10.0  # mm from stomion to subnasale: lips of adults are 16 to 30 mm high [X]
SEEN = 1.0  # mm of a hollow or a prominence off its chord: less is the surface's, or the scan does not show it [I]
LIP, FOLD = 0.3, 0.5  # share of the way from the mouth to the chin's lower end: lower lip, then its fold, then chin [I]


@dataclass(frozen=True)
class FaceLandmarks:
    """Skin landmarks (3,) mm LPS on the midline; wings of the nose and corners of the mouth (2, 3), right then left."""

    sellion: np.ndarray
    pronasale: np.ndarray
    subnasale: np.ndarray
    labrale_superius: np.ndarray
    stomion: np.ndarray
    labrale_inferius: np.ndarray
    sublabiale: np.ndarray
    pogonion: np.ndarray
    menton: np.ndarray
    alare: np.ndarray
    cheilion: np.ndarray


@lru_cache(maxsize=1)
def face_landmarks(patient: PatientModel) -> FaceLandmarks:
    """Landmarks of an upright face (+z up, looking to -y; some degrees of pitch do little).

    The midline is the middle of the upper jaw (:func:`upper_jaw`) down to the mouth; from
    there it runs to the middle of the chin's bone. Stomion lies between the nodes of the lips, else at the edge of
    the upper incisors; menton is the skin in front of the bone's lower end. All else lies farthest from a chord of
    the profile: pronasale in front of that from stomion to the top; subnasale behind that from stomion to pronasale;
    sellion behind that from pronasale to the top; pogonion in front of that from menton to stomion; sublabiale
    behind that from pogonion to the lower lip; labrale superius in front of that from the notch between the lips to
    subnasale; labrale inferius in front of that from sublabiale to the notch.

    Across the nose (the foremost of sections between subnasale and pronasale) the wings lie farthest behind the chords
    from the ridge to the cheeks; the mean of both sides counts. The mouth ends where its lip nodes end, but no nearer
    than the canon has it, because a closed or coarsely meshed slit shows in its middle only.

    Raises InputError where skin or bone is missing.
    """
    points, faces = patient.skin_points, patient.skin_faces
    upper = patient.bone_points[upper_jaw(patient)]
    if not len(faces) or not len(upper):
        raise _refused("it has no skin or no bone segment")
    middle = 0.5 * (upper[:, 0].min() + upper[:, 0].max())
    front = upper[np.abs(upper[:, 0] - middle) < TEETH]
    if not len(front):
        raise _refused("its upper jaw has nothing on the midline")
    edge = front[front[:, 1] < front[:, 1].min() + TEETH, 2].min()
    lips = [patient.points[patient.lip == lip] for lip in (UPPER_LIP, LOWER_LIP)]
    lips = [lip[np.abs(lip[:, 2] - edge) < SLIT] for lip in lips]
    central = [lip[np.abs(lip[:, 0] - middle) < TEETH, 2] for lip in lips]
    mouth = float(np.mean([np.median(lip) for lip in central])) if all(map(len, central)) else edge
    chin_x, chin_z = _chin(patient.bone_points, middle, mouth)

    z = np.arange(chin_z, min(points[:, 2].max(), mouth + FOREHEAD), STEP)
    x = np.interp(z, [chin_z, mouth], [chin_x, middle])
    depth = section(points, faces, points[:, 0] - np.interp(points[:, 2], z, x), points[:, 2], z)
    line = np.column_stack([depth, z])
    top, stomion = len(z) - 1, int(np.searchsorted(z, mouth))
    if min(stomion, top - stomion) * STEP < SLIT:
        raise _refused("skin or bone ends at the mouth")
    low, fold = (round(stomion * (1 - share)) for share in (FOLD, LIP))
    pronasale = farthest(line, stomion, top, True)
    subnasale = farthest(line, stomion, pronasale, False, min(stomion + int(SHORTEST_LIP / STEP), pronasale))
    sellion = farthest(line, pronasale, top, False, min(pronasale + int(BRIDGE / STEP), top), top)
    reach = int(SLIT / STEP)
    notch = farthest(line, stomion - reach, stomion + reach, False)  # where a lip overhangs, not at the mouth's height
    superius = farthest(line, notch, subnasale, True)
    pogonion = farthest(line, 0, stomion, True, 0, low)
    lower = farthest(line, 0, stomion, True, fold, stomion)
    sublabiale = farthest(line, pogonion, lower, False, low, fold)
    inferius = farthest(line, sublabiale, notch, True)

    out = np.arange(-CHEEK, CHEEK + STEP, STEP)
    levels = np.linspace(z[subnasale], z[pronasale], 6)[1:]
    sections = [section(points, faces, points[:, 2] - level, points[:, 0] - middle, out) for level in levels]
    across = np.min(sections, axis=0)
    ridge = len(out) // 2
    wings = [farthest(np.column_stack([across, out]), *ends, False) for ends in ((0, ridge), (ridge, len(out) - 1))]
    wing = float(np.clip(np.abs(out[wings]).mean(), *WING))
    canon = min(MOUTH * wing, WIDEST)
    reach = np.vstack(lips)[:, 0] - middle
    corners = np.clip([reach.min(initial=0), reach.max(initial=0)], [-WIDEST, canon], [-canon, WIDEST])
    beside = section(points, faces, points[:, 2] - mouth, points[:, 0] - middle, out)
    profile = np.column_stack([x, depth, z])
    return FaceLandmarks(
        *profile[[sellion, pronasale, subnasale, superius, stomion, inferius, sublabiale, pogonion, 0]],
        alare=np.array([(middle + a, np.interp(a, out, across), z[subnasale]) for a in (-wing, wing)]),
        cheilion=np.array([(middle + a, np.interp(a, out, beside), mouth) for a in corners]),
    )


def subspinale(patient: PatientModel, marks: FaceLandmarks) -> np.ndarray:
    """Soft-tissue A' (3,) mm: the profile's deepest point behind the chord from labrale superius to subnasale."""
    points, x = patient.skin_points, marks.subnasale[0]
    z = np.arange(marks.labrale_superius[2], marks.subnasale[2] + STEP / 2, STEP)
    depth = section(points, patient.skin_faces, points[:, 0] - x, points[:, 2], z)
    deepest = farthest(np.column_stack([depth, z]), 0, len(z) - 1, False)
    return np.array([x, depth[deepest], z[deepest]])


def unseen(patient: PatientModel, marks: FaceLandmarks) -> tuple[str, ...]:
    """Landmarks that the profile does not show: without a hollow at the root of the nose there is no sellion, nor a tip
    of the nose where the profile goes on to the forehead, because the scan then cuts the nose."""
    points, low = patient.skin_points, marks.pronasale[2]
    z = np.arange(low, min(points[:, 2].max(), marks.stomion[2] + FOREHEAD) + STEP / 2, STEP)
    depth = section(points, patient.skin_faces, points[:, 0] - marks.pronasale[0], points[:, 2], z)
    line, top = np.column_stack([depth, z]), len(z) - 1
    hollow, whole = off_chord(line, 0, top, farthest(line, 0, top, False)), z[top] - marks.stomion[2] > 0.9 * FOREHEAD
    return ("sellion", "pronasale", "columella")[: 0 if hollow > SEEN else 3 if whole else 1]


def _refused(problem: str) -> InputError:
    return InputError("-", "model", f"its face cannot be read: {problem}", "check the segmentation and its orientation")


def upper_jaw(patient: PatientModel) -> np.ndarray:
    """Which bone points (b,) are the upper jaw's: of its segments; where it is not cut, of the cranium above the lower
    jaw's teeth; without either, of every segment."""
    upper = of_segments(patient.bone_segment, patient.segments, "maxilla")
    lower = of_segments(patient.bone_segment, patient.segments, "distal", UNCUT)
    if not upper.any() and lower.any():
        upper = above_teeth(patient.bone_points, patient.bone_segment, lower)
    return upper if upper.any() else patient.bone_segment >= 0


def _chin(bone, middle: float, mouth: float) -> tuple[float, float]:
    """Middle x and lower end z (mm) of the chin's bone; what lies far behind it (jaw angle, neck) is left out."""
    below = bone[(bone[:, 2] < mouth - SLIT) & (np.abs(bone[:, 0] - middle) < CHEEK)]
    if not len(below):
        raise _refused("no bone lies below its mouth")
    below = below[below[:, 1] < below[:, 1].min() + CHIN]
    low = below[below[:, 2] < below[:, 2].min() + CHIN, 0]
    return 0.5 * (low.min() + low.max()), below[:, 2].min()


def section(points, faces, height, along, wanted) -> np.ndarray:
    """Foremost y (k,) mm of a surface where a plane cuts it, at each wanted place; interpolated where it has a gap.

    height (s,): of every point above the plane; along (s,): its place in the plane.
    """
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        one, two = faces[:, a], faces[:, b]
        crosses = (height[one] < 0) != (height[two] < 0)
        share = height[one] / np.where(crosses, height[one] - height[two], 1)
        place = [value[one] + share * (value[two] - value[one]) for value in (along, points[:, 1])]
        ends.append(np.where(crosses[:, None], np.column_stack(place), np.nan))
    ends = np.stack(ends, axis=1)
    cut = ends[np.isfinite(ends[:, :, 0]).sum(axis=1) == 2]
    ends = cut[np.isfinite(cut[:, :, 0])].reshape(-1, 2, 2)
    start, end = ends[:, 0, :, None], ends[:, 1, :, None]
    length = np.where(start[:, 0] == end[:, 0], 1, end[:, 0] - start[:, 0])
    share = (wanted - start[:, 0]) / length
    depth = np.where((share >= 0) & (share <= 1), start[:, 1] + share * (end[:, 1] - start[:, 1]), np.inf)
    foremost = depth.min(axis=0, initial=np.inf)
    known = np.isfinite(foremost)
    if not known.any():
        raise _refused("there is no skin where it is sought")
    return np.interp(wanted, wanted[known], foremost[known])


def farthest(line, start: int, end: int, ahead: bool, first: int | None = None, last: int | None = None) -> int:
    """Index of the point farthest in front of (or behind) the chord from `start` to `end` of a line (k, 2).

    line: depth (to the back) and place (rising); sought from `first` to `last`, by default between the ends.
    """
    low, high = sorted((start, end))
    first, last = low if first is None else first, high if last is None else last
    along, part = line[high] - line[low], line[first : last + 1] - line[low]
    behind = along[1] * part[:, 0] - along[0] * part[:, 1]
    return first + int(np.argmax(-behind if ahead else behind))


def off_chord(line, start: int, end: int, at: int) -> float:
    """How far (mm) a place of a line (k, 2), as of :func:`farthest`, lies behind the chord between two."""
    along, way = line[end] - line[start], line[at] - line[start]
    return float(along[1] * way[0] - along[0] * way[1]) / max(float(np.linalg.norm(along)), 1e-9)
