"""A virtual head as a label volume: bone segments, muscle, superficial tissue and the landmarks of the patient."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from pinnochio.model.labels import AIR, MUSCLE, SUPERFICIAL
from pinnochio.virtual.implicit import Field
from pinnochio.virtual.muscles import MUSCLES, muscle_region
from pinnochio.virtual.osteotomy import cut
from pinnochio.virtual.parameters import HeadParameters
from pinnochio.virtual.procedures import Procedure
from pinnochio.virtual.skeleton import Skeleton, mandible, upper_skull
from pinnochio.virtual.skin import mouth_line, profile, skin

USUAL = Procedure()
SEGMENTS = USUAL.segments
SKIN_LAYER = 3.5  # mm of superficial tissue over muscle at least [I]
SLIT = 1.4  # mm between the lips [I]
CRUMB = 300.0  # mm3; smaller pieces of muscle are left out [I]


@dataclass(frozen=True)
class Head:
    """labels (nx, ny, nz) uint8 internal codes; spacing, origin (3,) mm; landmarks name -> (3,) mm; its parameters and
    the procedure whose cuts its bones have."""

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    landmarks: dict[str, np.ndarray]
    parameters: HeadParameters
    procedure: Procedure = USUAL

    @property
    def segments(self) -> tuple[str, ...]:
        """The bone segments, in the order of their codes."""
        return self.procedure.segments


def grid(s: Skeleton, spacing: float) -> list[np.ndarray]:
    """Axes of the volume: cut at the tragi, 25 mm above nasion, 20 mm below the chin; air in front and beside."""
    p = s.p
    side = 0.5 * p.face_width + 14
    front = s.spine[1] - p.subnasale - p.nose_length - 9
    low, high = s.menton[2] - p.menton - 20, s.nasion[2] + 26
    half = np.ceil(side / spacing) * spacing
    ends = ((-half, half), (front, 1.0), (low, high))
    return [np.arange(np.floor(a / spacing), np.floor(b / spacing) + 1) * spacing for a, b in ends]


def build_head(
    parameters: HeadParameters,
    spacing: float = 1.0,
    procedure: Procedure = USUAL,
    muscles: Iterable[str] = MUSCLES,
) -> Head:
    """Label volume of one virtual patient on cubes of `spacing` mm.

    procedure: the cuts, whose segments the head has; muscles: what is labelled as muscle, any of :data:`MUSCLES`, the
    rest is superficial tissue. Raises ValueError for other names.
    """
    s = Skeleton(parameters)
    axes = grid(s, spacing)
    upper, cheeks = upper_skull(s, axes, reach=12)
    jaw = mandible(s, axes, reach=12)
    points = profile(s)
    face = skin(s, points, upper, cheeks, jaw)
    x, y, z = (axis.astype(np.float32) for axis in axes)
    x, y, z = x[:, None, None], y[None, :, None], z[None, None, :]

    bone = cut(s, upper.values < 0, jaw.values < 0, (x, y, z), procedure)
    inside = (face.values < 0) & ~_oral(s, x, y, z) & ~_slit(s, points, x, y, z, spacing)
    labels = np.where(bone > 0, bone, np.where(inside, SUPERFICIAL, AIR)).astype(np.uint8)
    _clean(labels)
    deep = (labels == SUPERFICIAL) & _deep(face, labels, spacing)
    labels[deep & muscle_region(s, points, axes, muscles)] = MUSCLE
    _absorb(labels, SUPERFICIAL, MUSCLE)
    _absorb(labels, MUSCLE, SUPERFICIAL, CRUMB / spacing**3)
    origin = np.array([axis[0] for axis in axes])
    marks = landmarks(s, points, labels, axes)
    return Head(labels, np.full(3, spacing), origin, marks, parameters, procedure)


def _interior(line: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Inside of an arch, open to the back, in the axial plane."""
    order = np.argsort(line[:, 0])
    front = np.interp(x[:, :, 0], line[order, 0], line[order, 1], left=np.inf, right=np.inf)
    return (y[:, :, 0] > front)[:, :, None]


def _oral(s: Skeleton, x, y, z) -> np.ndarray:
    """Mouth and throat: air behind the dental arches and between the rami."""
    scale = 1 + 3.0 / np.abs(s.arch_upper[:, 0]).max()
    between = 0.5 * (s.upper_edge(y) + s.lower_edge(y))
    rear = (y > s.molar_y) & (np.abs(x) < np.where(z > between, 37, 27) * s.wide) & (z < -8) & (z > between - 24)
    top = _interior(s.arch_upper * [scale, 1] + [0, 2.0], x, y) & (z > between) & (z < s.spine[2] + 1)
    low = _interior(s.arch_lower * [scale, 1] + [0, 2.0], x, y) & (z <= between) & (z > between - 20)
    front = (top | low) & (y <= s.molar_y)
    throat = ((x / (38 * s.wide)) ** 2 + ((y - 2) / 35) ** 2 < 1) & (z < -8)
    return front | rear | throat


def _slit(s: Skeleton, points, x, y, z, spacing: float) -> np.ndarray:
    """Gap between the lips, from the skin to the teeth."""
    line = mouth_line(s, points, 41)
    height = np.interp(x, line[:, 0], line[:, 2]).astype(np.float32)
    teeth = np.maximum(
        *(np.interp(x, a[:, 0], a[:, 1], left=np.inf, right=np.inf) for a in (s.arch_upper, s.arch_lower))
    )
    span = (x > line[0, 0]) & (x < line[-1, 0])
    return span & (np.abs(z - height) < max(SLIT, 1.3 * spacing) / 2) & (y < teeth + 4)


def _deep(face: Field, labels: np.ndarray, spacing: float) -> np.ndarray:
    """Deep enough below the skin, and away from the surfaces of the lips and the mouth, to be muscle."""
    skin_steps, mouth_steps = max(int(np.ceil(3 / spacing)), 1), max(round(2 / spacing), 1)
    below_skin = ndimage.binary_erosion(face.values < 0, iterations=skin_steps, border_value=1)
    off_air = ndimage.binary_erosion(labels != AIR, iterations=mouth_steps, border_value=1)
    return (face.values < -SKIN_LAYER) & below_skin & off_air


def _absorb(labels: np.ndarray, code: int, into: int | None = None, crumb: float = np.inf) -> int:
    """Give the parts of a label below `crumb` voxels, but never the largest, the label `into` or the one around them.

    Returns their number.
    """
    parts, _ = ndimage.label(labels == code)
    size = np.bincount(parts.ravel())
    size[0] = 0
    small = np.setdiff1d(np.flatnonzero(size < crumb), [0, size.argmax()])
    boxes = ndimage.find_objects(parts)
    for number in small:
        wide = tuple(slice(max(s.start - 1, 0), s.stop + 1) for s in boxes[number - 1])
        own = parts[wide] == number
        rim = labels[wide][ndimage.binary_dilation(own) & ~own]
        labels[wide][own] = np.bincount(rim).argmax() if into is None else into
    return len(small)


def _clean(labels: np.ndarray) -> None:
    """One connected component per label: no islands, no enclosed air."""
    for _ in range(5):
        if not sum(_absorb(labels, code) for code in np.unique(labels)):
            break


def landmarks(s: Skeleton, points, labels: np.ndarray, axes) -> dict[str, np.ndarray]:
    """Landmarks (3,) mm; those of the skin lie on the labelled surface."""
    solid = labels != AIR

    def on_skin(point):
        """First tissue from the front at the point's x and z."""
        i, k = (int(np.argmin(np.abs(axis - value))) for axis, value in ((axes[0], point[0]), (axes[2], point[2])))
        hit = np.flatnonzero(solid[i, :, k])
        return np.array(
            [point[0], axes[1][hit[0]] - 0.5 * (axes[1][1] - axes[1][0]) if len(hit) else point[1], point[2]]
        )

    names = ("glabella", "nasion", "pronasale", "subnasale", "labrale_superius", "labrale_inferius", "mentolabial",
             "pogonion_soft")  # fmt: skip
    marks = {name: on_skin(points[name]) for name in names}
    marks["menton_soft"] = points["menton_soft"]
    line = mouth_line(s, points)
    marks["cheilion_left"], marks["cheilion_right"] = on_skin(line[-1] + [2, 0, 0]), on_skin(line[0] - [2, 0, 0])
    for name, side in (("left", 1.0), ("right", -1.0)):
        column = np.flatnonzero(solid[:, -1, int(np.argmin(np.abs(axes[2])))])
        marks[f"tragus_{name}"] = np.array([axes[0][column[-1 if side > 0 else 0]], 0.0, 0.0])
        marks[f"condyle_{name}"] = s.condyle_of(side)
    marks["upper_incisor"], marks["lower_incisor"] = s.upper_incisor, s.lower_incisor
    marks["pogonion_bone"], marks["a_point"] = s.pogonion, s.a_point
    marks["b_point"] = points["mentolabial"] + [0, s.p.mentolabial, 0]
    return marks
