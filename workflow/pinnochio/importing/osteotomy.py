"""Cuts skull and mandible of a head into the segments of an operation, by landmarks, planes, or what the bone shows."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from pinnochio.errors import refusal
from pinnochio.geometry.plane import Plane
from pinnochio.importing.head_parts import HeadParts
from pinnochio.importing.markups import Markups
from pinnochio.importing.presets import LOWER, LOWER_TEETH, MANDIBLE, MUSCLE, SKULL, SOFT, UPPER, UPPER_TEETH
from pinnochio.importing.segmentation import plain_name
from pinnochio.importing.soft_tissue import largest
from pinnochio.model.labels import AIR, CRANIUM, SUPERFICIAL, TOUCHING, segment_code
from pinnochio.model.labels import MUSCLE as MUSCLE_CODE
from pinnochio.plans.roles import GUESS

LOG = logging.getLogger(__name__)
DRAWN = "the piece that the segmentation holds"
LEFORT, SPLIT, CHIN = "lefort1", "split", "chin"
CUTS = (LEFORT, SPLIT, CHIN)
SIDES = {"right": -1.0, "left": 1.0}  # LPS: +x is the patient's left
# The rule [I], mm. Le Fort I: 5 mm above the roots, as surgeons keep from them [R].
ABOVE_ROOTS, ABOVE_FLOOR, BEHIND_MOLARS, BESIDE_MOLARS = 5.0, 5.0, 6.0, 14.0
# Sagittal split: the outer plate from the second molar back; all of the bone behind the lingula and above the teeth.
HALF_ARCH = 30.0  # half the width of an upper arch, where no teeth show it [R: between molars 55 to 62 mm]
PLATE, LINGULA, ABOVE_TEETH = 15.0, 12.0, 6.0
# Without teeth: heights at which the front of the ramus is read, of the way from angle to condyle; where teeth end, of
# that way; and of the way from chin to angle, where a last molar lies at least: 0.35 to 0.5 on heads with teeth [X].
RAMUS, TEETH_END, FOREMOST = (0.45, 0.55, 0.65), 0.35, 0.45
CHIN_HEIGHT, CHIN_WIDTH, BELOW_ROOTS = 13.0, 20.0, 3.0
STEEPEST = 0.5  # slope of an occlusal plane that is believed [I]
LEAST = 1.0  # cm3 of a segment that a cut makes
LATERAL = 0.6  # of the lower jaw's half width: its angles lie further out [I]
# mm: a landmark from its bone; from where it is found, and from another one that is found, where it is exchanged [I].
OFF_BONE, ELSEWHERE, NEAR_ANOTHER = 10.0, 25.0, 12.0
# How people call the landmarks, without case, blanks and signs: the name here.
NAMES = {plain_name(name): name for name in ("Me", "Pog", "ANS", "PNS", "RGo", "LGo", "RCo", "LCo")}
NAMES |= {"menton": "Me", "pogonion": "Pog", "anteriornasalspine": "ANS", "posteriornasalspine": "PNS"}
for _side in SIDES:
    for _word, _short in (("gonion", "Go"), ("condylion", "Co"), ("go", "Go"), ("co", "Co")):
        _name = _side[0].upper() + _short
        NAMES |= {_side + _word: _name, _word + _side: _name, _word + _side[0]: _name, _side[0] + _word: _name}
FRONT, CONDYLE = 12.0, 8.0  # mm: depth of the front of a jaw, height of a condyle


@dataclass(frozen=True)
class Osteotomy:
    """labels (nx, ny, nz) uint8 internal codes; segments in the order of their codes.

    landmarks: place (3,) mm and where it comes from, by name; cuts: of each cut what decided where it lies.
    """

    labels: np.ndarray
    segments: tuple[str, ...]
    landmarks: dict[str, tuple[np.ndarray, str]]
    cuts: dict[str, str]


def osteotomy(head: HeadParts, cuts: Sequence[str], markups: Markups, case: str, file: object) -> Osteotomy:
    """The segments that these cuts (of CUTS) make of a head's parts.

    Le Fort I: upper bone below a plane, in front of the pterygoid plates. The plane is the one called `lefort1`; or
    lies ABOVE_FLOOR over the points ANS and PNS; or ABOVE_ROOTS over the roots of the upper teeth, turned with the
    occlusal plane. Split: of each side what lies behind the plane called `split_left`, `split_right`; or the outer
    plate from PLATE before the last molar, and all behind LINGULA after it or above the teeth. Without the split the
    mandible stays in one piece. Chin: below the plane called `chin`, or CHIN_HEIGHT over Me, below the roots.
    A piece that the segmentation holds (:data:`~pinnochio.importing.presets.PIECES`) goes before all rules. Landmarks
    that no markup gives (:func:`find_landmarks`) are found on the bone, and said to be. Raises InputError.
    """
    refuse = refusal(case, file)
    parts, spacing = head.parts, float(head.spacing[0])
    x, y, z = np.meshgrid(
        *(head.origin[axis] + spacing * np.arange(n, dtype=np.float32) for axis, n in enumerate(parts.shape)),
        indexing="ij",
        sparse=True,
    )
    places = (x, y, z)
    landmarks = find_landmarks(head)
    landmarks |= {name: (place, "given") for name, place in _marked(head, markups, landmarks, case, refuse).items()}
    known = {plain_name(name): name for name in (LEFORT, CHIN, *(f"{SPLIT}_{side}" for side in SIDES))}
    planes = {known.get(plain_name(name), name): plane for name, plane in markups.planes.items()}
    if strange := [name for name in planes if name not in known.values() and "midline" not in plain_name(name)]:
        refuse(f"plane {strange[0]!r} is no cut known here", f"name the planes {', '.join(known.values())}")
    upper, lower = np.isin(parts, UPPER), np.isin(parts, LOWER)
    bone = np.where(upper | lower, CRANIUM, AIR).astype(np.uint8)
    segments, said = [], {}

    def add(name: str, mask) -> None:
        if mask.sum() * spacing**3 < LEAST * 1000:
            problem = f"the cut leaves {mask.sum() * spacing**3 / 1000:.2f} cm3 of {name!r}"
            refuse(problem, "give landmarks or planes as markups, or leave the cut out of 'osteotomy.cuts'")
        bone[mask] = segment_code(len(segments))
        segments.append(name)

    cuts = [*cuts, *([CHIN] if head.piece(CHIN) is not None else [])]
    if LEFORT in cuts:
        piece, said[LEFORT] = head.piece("lefort1"), DRAWN
        if piece is None:
            piece, said[LEFORT] = _lefort(parts, upper, places, landmarks, planes.get(LEFORT), spacing, refuse)
        add("lefort1", upper & piece | (parts == UPPER_TEETH))
    chin = np.zeros(parts.shape, bool)
    rami = {}
    if SPLIT in cuts:
        for side, sign in SIDES.items():
            piece, why = head.piece(f"proximal_{side}"), DRAWN
            if piece is None:
                piece, why = _split(parts, lower, places, landmarks, sign, planes.get(f"{SPLIT}_{side}"))
            rami[side], said[f"{SPLIT}_{side}"] = lower & piece & (parts != LOWER_TEETH), why
        _tidy(lower, rami)
    body = lower & ~np.logical_or.reduce([np.zeros_like(lower), *rami.values()])
    if CHIN in cuts:
        chin, said[CHIN] = head.piece(CHIN), DRAWN
        if chin is None:
            chin, said[CHIN] = _chin(parts, body, places, landmarks, planes.get(CHIN))
        chin &= body & (parts == MANDIBLE)
    add("mandible_distal" if rami else "mandible", body & ~chin)
    for side in ("left", "right"):
        if rami:
            add(f"proximal_{side}", rami[side])
    if CHIN in cuts:
        add("chin", chin)
    bone[parts == SOFT], bone[parts == MUSCLE] = SUPERFICIAL, MUSCLE_CODE
    return Osteotomy(bone, tuple(segments), landmarks, said)


def _marked(head: HeadParts, markups: Markups, landmarks, case: str, refuse) -> dict[str, np.ndarray]:
    """Place (3,) mm of each landmark that is marked, by its name here; names are matched by :data:`NAMES`.

    Refused where it lies off the bone that has it, where another landmark of that bone is sought, or where left and
    right are exchanged; a point that is no landmark is said.
    """
    points, strange = {}, []
    for name, place in markups.points.items():
        known = NAMES.get(plain_name(name))
        if known is None:
            strange.append(name)
        elif known in points:
            refuse(f"{known!r} is marked twice", "keep one point of it")
        else:
            points[known] = place
    if strange:
        said = "points that are no landmark known here are not used: %s (known: %s)"
        LOG.warning(f"case %r: {said}", case, ", ".join(map(repr, strange)), ", ".join(dict.fromkeys(NAMES.values())))
    for name, place in points.items():
        bone = _points(head, *(UPPER if name in ("ANS", "PNS") else LOWER))
        off = float(np.linalg.norm(bone - place, axis=1).min())
        if not off <= OFF_BONE:
            problem = f"{name!r} is marked {off:.0f} mm off the bone that has it"
            refuse(problem, "check its name and the frame (LPS, RAS) and unit (mm) of the markups")
        away = {other: float(np.linalg.norm(place - at)) for other, (at, _) in landmarks.items()}
        nearest = min(away, key=away.get)
        if away.get(name, 0) > ELSEWHERE and away[nearest] < NEAR_ANOTHER:
            refuse(f"{name!r} is marked where {nearest!r} is", "check which is which")
    for right, left in (("RCo", "LCo"), ("RGo", "LGo")):
        if right in points and left in points and points[right][0] > points[left][0]:
            problem = f"{right!r} lies on the left of {left!r}"
            refuse(problem, "exchange their names, or set 'orientation' if the header of the segmentation is mirrored")
    if {"ANS", "PNS"} <= points.keys() and points["ANS"][1] > points["PNS"][1]:
        refuse("'ANS' lies behind 'PNS'", "exchange their names")
    return points


def find_landmarks(head: HeadParts) -> dict[str, tuple[np.ndarray, str]]:
    """Me, Pog, RGo, LGo, RCo, LCo and, with upper teeth, ANS on the bone: place (3,) mm and "found on the bone".

    Me: the lowest of the chin's middle; Pog its foremost. Go: the outermost corner, behind and below, of each side. Co:
    the middle of the top of what lies behind the middle of each ramus: the condyle, not the coronoid. ANS: the foremost
    of the skull's middle about the roots of the upper teeth.
    """
    jaw, skull, teeth = (_points(head, *codes) for codes in (LOWER, (SKULL,), (UPPER_TEETH,)))
    front = jaw[jaw[:, 1] < jaw[:, 1].min() + FRONT]
    middle = float(np.median(front[:, 0]))
    chin = jaw[(np.abs(jaw[:, 0] - middle) < 10) & (jaw[:, 1] < jaw[:, 1].min() + 2 * FRONT)]
    menton = chin[chin[:, 2].argmin()]
    below = chin[chin[:, 2] < menton[2] + 25]
    landmarks = {"Me": menton, "Pog": below[below[:, 1].argmin()]}
    across = (jaw[:, 0].min() + jaw[:, 0].max()) / 2
    for side, sign in SIDES.items():
        half = jaw[sign * (jaw[:, 0] - across) > 0]
        lateral = half[sign * (half[:, 0] - across) > LATERAL * (jaw[:, 0].max() - jaw[:, 0].min()) / 2]
        corner = lateral[(lateral[:, 1] - lateral[:, 2]).argmax()]
        ramus = half[half[:, 2] > (half[:, 2].min() + half[:, 2].max()) / 2]
        behind = ramus[ramus[:, 1] > (ramus[:, 1].min() + ramus[:, 1].max()) / 2]
        if not len(behind):
            continue
        letter = side[0].upper()
        landmarks[f"{letter}Go"] = corner
        landmarks[f"{letter}Co"] = behind[behind[:, 2] > behind[:, 2].max() - CONDYLE].mean(axis=0)
    if len(teeth):
        roots, centre = np.percentile(teeth[:, 2], 98), (teeth[:, 0].min() + teeth[:, 0].max()) / 2
        spine = skull[(np.abs(skull[:, 0] - centre) < 5) & (np.abs(skull[:, 2] - roots - 3) < 10)]
        if len(spine):
            landmarks["ANS"] = spine[spine[:, 1].argmin()]
    return {name: (place, "found on the bone") for name, place in landmarks.items()}


def _points(head: HeadParts, *codes: int) -> np.ndarray:
    return np.argwhere(np.isin(head.parts, codes)) * head.spacing + head.origin


def _at(index, places) -> np.ndarray:
    """Places (k, 3) mm of voxels (k, 3)."""
    return np.column_stack([np.ravel(coordinate)[index[:, axis]] for axis, coordinate in enumerate(places)])


def _height(plane: Plane, places) -> np.ndarray:
    """Signed distance (nx, ny, nz) of every voxel from the plane."""
    return (
        sum(coordinate * normal for coordinate, normal in zip(places, plane.normal, strict=True))
        - plane.point @ plane.normal
    )


def _upward(plane: Plane, axis: int) -> Plane:
    return plane if plane.normal[axis] > 0 else Plane(plane.point, -plane.normal)


def _lefort(parts, upper, places, landmarks, plane, spacing, refuse):
    """Voxels of the maxilla, and what decided."""
    x, y, z = places
    teeth = parts == UPPER_TEETH
    index = np.argwhere(teeth)
    marked = [landmarks[name][0] for name in ("ANS", "PNS") if landmarks.get(name, ("", ""))[1] == "given"]
    if plane is not None:
        plane, why = _upward(plane, 2), "the plane that was given"
    elif len(marked) == 2:
        along = (marked[1] - marked[0]) / np.linalg.norm(marked[1] - marked[0])
        normal = np.cross([1.0, 0, 0], along) * np.sign(along[1] or 1)
        plane = _upward(Plane(marked[0], normal / np.linalg.norm(normal)), 2)
        plane = Plane(plane.point + ABOVE_FLOOR * plane.normal, plane.normal)
        why = f"{ABOVE_FLOOR:g} mm above ANS and PNS, which were given"
    elif len(index):
        at = _at(index, places)
        normal = _occlusal(at)
        roots = np.percentile(at @ normal, 98)
        plane = Plane(normal * (roots + ABOVE_ROOTS), normal)
        why = f"{ABOVE_ROOTS:g} mm above the roots of the upper teeth{GUESS}"
    else:
        problem = "no upper teeth and neither ANS nor PNS say where the Le Fort I cut lies"
        refuse(problem, "give the points ANS and PNS, or a plane 'lefort1', as markups (.mrk.json)")
    below = upper & (_height(plane, places) < 0)
    if len(index):
        at = _at(index, places)
        rear, centre = np.percentile(at[:, 1], 99) + BEHIND_MOLARS, (at[:, 0].min() + at[:, 0].max()) / 2
        below &= (y < rear) & (np.abs(x - centre) < (at[:, 0].max() - at[:, 0].min()) / 2 + BESIDE_MOLARS)
    elif "PNS" in landmarks:
        spine, rear = landmarks.get("ANS", landmarks["Me"])[0][0], landmarks["PNS"][0][1] + BEHIND_MOLARS
        below &= (y < rear) & (np.abs(x - spine) < HALF_ARCH + BESIDE_MOLARS)
    return largest(below, TOUCHING) | teeth, why


def _occlusal(teeth) -> np.ndarray:
    """Unit normal, upward, of the plane from the edges of the incisors to those of the last molars; not rolled."""
    front = teeth[teeth[:, 1] < teeth[:, 1].min() + FRONT]
    rear = teeth[teeth[:, 1] > teeth[:, 1].max() - FRONT]
    one, two = (np.array([np.median(end[:, 1]), np.percentile(end[:, 2], 5)]) for end in (front, rear))
    slope = (two[1] - one[1]) / max(two[0] - one[0], 1.0)
    slope = slope if abs(slope) < STEEPEST else 0.0
    return np.array([0.0, -slope, 1.0]) / np.hypot(slope, 1.0)


def _split(parts, lower, places, landmarks, sign: float, plane):
    """Voxels of the proximal segment of a side, and what decided."""
    x, y, z = places
    middle = landmarks["Me"][0][0]
    side = "RL"[sign > 0]
    across = [landmarks[name][0][0] for name in ("RCo", "LCo") if name in landmarks]
    half = lower & (sign * (x - (np.mean(across) if len(across) == 2 else middle)) > 0)
    teeth = half & (parts == LOWER_TEETH)
    if plane is not None:
        condyle = landmarks.get(f"{side}Co", landmarks["Me"])[0]
        if plane.height(condyle) < 0:
            plane = Plane(plane.point, -plane.normal)
        return half & ~teeth & (_height(plane, places) > 0), "the plane that was given"
    index = np.argwhere(teeth)
    if len(index):
        at = _at(index, places)
        molar = np.percentile(at[:, 1], 98)
        edge = np.percentile(at[at[:, 1] > molar - FRONT, 2], 98)
        why = f"the last lower molar{GUESS}"
    else:
        corner, top, chin = (landmarks[name][0] for name in (f"{side}Go", f"{side}Co", "Me"))
        molar = max(_ramus_front(half, places, corner[2], top[2]), chin[1] + FOREMOST * (corner[1] - chin[1]))
        edge = corner[2] + TEETH_END * (top[2] - corner[2])
        why = f"the front of the ramus, without teeth{GUESS}"
    body = half & ~teeth & (z < edge)
    count = body.sum(axis=(0, 2))
    mean = np.where(count > 0, (body * np.abs(x - middle)).sum(axis=(0, 2)) / np.maximum(count, 1), np.inf)
    outer = np.abs(x - middle) > mean[None, :, None]
    proximal = (
        (y > molar + LINGULA) | ((z > edge + ABOVE_TEETH) & (y > molar - LINGULA)) | (outer & (y > molar - PLATE))
    )
    return half & ~teeth & proximal, why


def _ramus_front(half, places, low: float, high: float) -> float:
    """Where (y, mm) the ramus of a half of the mandible begins, at RAMUS of the height between angle and condyle: the
    last molar ends there, on steep jaws as on flat ones."""
    fronts = []
    for share in RAMUS:
        level = int(np.abs(np.ravel(places[2]) - low - share * (high - low)).argmin())
        filled = np.flatnonzero(half[:, :, level].any(axis=0))
        if len(filled):  # from behind, up to the first gap
            gaps = np.flatnonzero(np.diff(filled) > 2)
            fronts.append(np.ravel(places[1])[filled[gaps[-1] + 1 if len(gaps) else 0]])
    return float(np.median(fronts)) if fronts else -np.inf


def _tidy(lower, rami: dict[str, np.ndarray]) -> None:
    """Leave each piece of the mandible whole: crumbs of a ramus go to the body, crumbs of the body to the rami."""
    for mask in rami.values():
        mask &= largest(mask, TOUCHING)
    body = lower & ~np.logical_or.reduce(list(rami.values()))
    crumbs, _ = ndimage.label(body & ~largest(body, TOUCHING), TOUCHING)
    for number, box in enumerate(ndimage.find_objects(crumbs), 1):
        wide = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in box)
        crumb = crumbs[wide] == number
        rim = ndimage.binary_dilation(crumb, TOUCHING)
        touched = {side: (rim & mask[wide]).sum() for side, mask in rami.items()}
        side = max(touched, key=touched.get)
        if touched[side]:
            rami[side][wide] |= crumb


def _chin(parts, body, places, landmarks, plane):
    """Voxels of the chin, and what decided."""
    x, y, z = places
    menton, how = landmarks["Me"]
    if plane is not None:
        if plane.height(menton) > 0:
            plane = Plane(plane.point, -plane.normal)
        return body & (parts == MANDIBLE) & (_height(plane, places) < 0), "the plane that was given"
    top, why = menton[2] + CHIN_HEIGHT, f"{CHIN_HEIGHT:g} mm above Me, which was {how}"
    why += "" if how == "given" else GUESS
    index = np.argwhere(parts == LOWER_TEETH)
    if len(index):
        at = _at(index, places)
        roots = np.percentile(at[at[:, 1] < at[:, 1].min() + FRONT, 2], 2)
        if roots - BELOW_ROOTS < top:
            top, why = roots - BELOW_ROOTS, f"{BELOW_ROOTS:g} mm below the roots of the lower front teeth{GUESS}"
    near = (z < top) & (np.abs(x - menton[0]) < CHIN_WIDTH)
    return body & (parts == MANDIBLE) & near & (y < menton[1] + 2 * FRONT), why
