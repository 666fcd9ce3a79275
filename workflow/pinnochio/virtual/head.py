"""A virtual head as a label volume: bone segments, muscle, superficial tissue and the landmarks of the patient."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from pinnochio.model.labels import AIR, MUSCLE, SUPERFICIAL
from pinnochio.virtual.carry import anatomy
from pinnochio.virtual.cavities import MUCOSA, WALL, air_in, airway, behind_lips, oral, slit
from pinnochio.virtual.cuts import cut
from pinnochio.virtual.morphable_model import ModelFace, face_solid
from pinnochio.virtual.muscles import muscle_region
from pinnochio.virtual.parameters import HeadParameters
from pinnochio.virtual.procedures import Procedure
from pinnochio.virtual.skeleton import Skeleton, mandible, upper_skull

USUAL = Procedure()
SEGMENTS = USUAL.segments
SKIN_LAYER = 3.5  # mm of superficial tissue over muscle at least [I]
LEAST = 2.5  # mm of tissue over any bone but that behind the lips [I]
BETWEEN = 2.3  # voxels there at least: two of tissue, since a coarse mesh leaves out a layer of one
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


def build_head(parameters: HeadParameters, spacing: float = 1.0, procedure: Procedure = USUAL) -> Head:
    """Label volume of one virtual patient on cubes of `spacing` mm.

    procedure: the cuts, whose segments the head has.
    """
    s = Skeleton(parameters)
    soft = _soft(s, spacing)
    axes = soft.axes
    x, y, z = np.ix_(*(axis.astype(np.float32) for axis in axes))

    bone = cut(s, soft.skull, soft.jaw, (x, y, z), procedure)
    mouth = oral(s, x, y, z) & (soft.depth > WALL)
    inside = (soft.depth > 0) & ~soft.air & ~mouth & ~slit(s, soft.line, x, y, z, spacing)
    labels = np.where(bone > 0, bone, np.where(inside, SUPERFICIAL, AIR)).astype(np.uint8)
    _clean(labels)
    deep = (labels == SUPERFICIAL) & _deep(soft.depth, labels, spacing)
    labels[deep & muscle_region(s, soft.points, soft.line, axes)] = MUSCLE
    _absorb(labels, SUPERFICIAL, MUSCLE)
    _absorb(labels, MUSCLE, SUPERFICIAL, CRUMB / spacing**3)
    origin = np.array([axis[0] for axis in axes])
    marks = landmarks(s, soft, labels)
    return Head(labels, np.full(3, spacing), origin, marks, parameters, procedure)


@dataclass(frozen=True)
class _Soft:
    """What a face gives: axes; depth below the skin (mm), bones and further air on the grid; points and mouth."""

    axes: list[np.ndarray]
    depth: np.ndarray
    skull: np.ndarray
    jaw: np.ndarray
    air: np.ndarray
    points: dict[str, np.ndarray]
    line: np.ndarray


def _soft(s: Skeleton, spacing: float) -> _Soft:
    """The face carried into the deformity, the skull sculpted below it, the nasal airway open."""
    carried = anatomy(s.p)
    face = carried.face
    axes = face_grid(s, face, spacing)
    x, y, z = np.ix_(*axes)
    upper = upper_skull(s, axes, reach=12)
    jaw = mandible(s, axes, reach=12)
    carried.sculpt(upper, jaw)
    upper.subtract(*airway(s, face.nostrils, MUCOSA))
    inside = face_solid(face, axes) | behind_lips(face.line, x, y, z)
    depth = ndimage.distance_transform_edt(inside, sampling=spacing).astype(np.float32)
    covered = (depth > max(LEAST, BETWEEN * spacing)) | behind_lips(face.line - [0, 8, 0], x, y, z)
    air = air_in(airway(s, face.nostrils), axes)
    return _Soft(axes, depth, (upper.values < 0) & covered, (jaw.values < 0) & covered, air, face.marks, face.line)


def face_grid(s: Skeleton, face: ModelFace, spacing: float) -> list[np.ndarray]:
    """Axes of the volume: cut at the tragi, 26 mm above nasion, 20 mm below the chin; air in front and beside."""
    anterior = face.points[(face.points[:, 1] < 3) & (face.points[:, 2] > s.menton[2] - 40)]
    half = np.ceil((np.abs(anterior[:, 0]).max() + 6) / spacing) * spacing
    low, high = face.marks["menton_soft"][2] - 20, s.nasion[2] + 26
    ends = ((-half, half), (anterior[:, 1].min() - 9, 1.0), (low, high))
    return [np.arange(np.floor(a / spacing), np.floor(b / spacing) + 1) * spacing for a, b in ends]


def _deep(depth: np.ndarray, labels: np.ndarray, spacing: float) -> np.ndarray:
    """Deep enough below the skin, and away from the surfaces of the lips and the mouth, to be muscle."""
    skin_steps, mouth_steps = max(int(np.ceil(3 / spacing)), 1), max(round(2 / spacing), 1)
    below_skin = ndimage.binary_erosion(depth > 0, iterations=skin_steps, border_value=1)
    off_air = ndimage.binary_erosion(labels != AIR, iterations=mouth_steps, border_value=1)
    return (depth > SKIN_LAYER) & below_skin & off_air


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
        inside = parts[wide] == number
        rim = labels[wide][ndimage.binary_dilation(inside) & ~inside]
        labels[wide][inside] = np.bincount(rim).argmax() if into is None else into
    return len(small)


def _clean(labels: np.ndarray) -> None:
    """One connected component per label: no islands, no enclosed air."""
    for _ in range(5):
        if not sum(_absorb(labels, code) for code in np.unique(labels)):
            break


def landmarks(s: Skeleton, soft: _Soft, labels: np.ndarray) -> dict[str, np.ndarray]:
    """Landmarks (3,) mm; those of the skin lie on the labelled surface."""
    points, line, axes = soft.points, soft.line, soft.axes
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
    marks["cheilion_left"], marks["cheilion_right"] = on_skin(line[-1] + [2, 0, 0]), on_skin(line[0] - [2, 0, 0])
    for name, side in (("left", 1.0), ("right", -1.0)):
        marks[f"tragus_{name}"] = points[f"tragus_{name}"]
        marks[f"condyle_{name}"] = s.condyle_of(side)
    marks["upper_incisor"], marks["lower_incisor"] = s.upper_incisor, s.lower_incisor
    marks["pogonion_bone"], marks["a_point"] = s.pogonion, s.a_point
    marks["b_point"] = points["mentolabial"] + [0, s.p.mentolabial, 0]
    return marks
