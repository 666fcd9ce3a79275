"""The skin of a deformed patient: the normal head's tissue, as elastic, carried by the jaws into the deformity."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import ndimage
from scipy.interpolate import RBFInterpolator
from scipy.sparse import coo_array

from pinnochio.geometry.interpolation import interpolate
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.sliding import SlidingSet
from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model.labels import AIR, CRANIUM, SUPERFICIAL
from pinnochio.virtual.cavities import WALL, behind_lips, oral
from pinnochio.virtual.implicit import Field
from pinnochio.virtual.morphable_model import ModelFace, face_solid, first_hit, make_face
from pinnochio.virtual.parameters import HeadParameters
from pinnochio.virtual.rays import REACH, SITES, STEP, sites
from pinnochio.virtual.skeleton import SIDES, Skeleton, mandible, upper_skull

SPACING, NODES = 2.0, 3500  # mm, nodes: the coarse head on which the skin is carried
BELOW, ABOVE = 45.0, 30.0  # mm of it below the chin and above nasion
POISSON = 0.45  # stiff enough in volume, and no locking to speak of [I]
CONTACT = 1.6  # mm from bone within which a node of the mesh's surface touches it
MOUTH = 18.0  # mm about the line of the lips within which tissue slides over teeth and gums [I]
FADE = 8.0  # mm over which the maxilla's motion passes into the cranium's rest
SMOOTHING = 6  # passes of averaging of the carried field over the skin's triangles
BRUSHED = tuple(name for name in SITES if name not in ("labrale_superius", "labrale_inferius", "cheek"))
LARGEST, OF_RAMUS = 5.0, 1.5  # mm by which bone, and the thin ramus, is raised or dented at a landmark at most [I]
ROUNDS = 3


@dataclass(frozen=True)
class Stroke:
    """Correction of a bone's surface: raised by `amount` mm about a place (3,) mm, Gaussian of `width` mm."""

    jaw: bool
    place: np.ndarray
    amount: float
    width: float


@dataclass(frozen=True)
class CarriedFace:
    """A patient's face after the deformity, and the corrections of the skull below it."""

    face: ModelFace
    strokes: tuple[Stroke, ...]

    def sculpt(self, upper: Field, jaw: Field) -> None:
        """Bring the bones to the thickness that the landmarks had before the deformity."""
        for stroke in self.strokes:
            (jaw if stroke.jaw else upper).brush([stroke.place], stroke.amount, stroke.width)


@lru_cache(maxsize=32)
def anatomy(parameters: HeadParameters) -> CarriedFace:
    """The face of a patient, carried from the normal person's by the motion of the jaws."""
    normal = parameters.scanned.normal
    face, before, after = make_face(parameters.scanned.identity), Skeleton(normal), Skeleton(parameters)
    axes = _axes(face, before)
    upper, jaw = upper_skull(before, axes, reach=12), mandible(before, axes, reach=12)
    strokes = fit_bone(upper, jaw, face, before)
    motion = jaw_motion(before, after)
    field = _carried(face, before, after, axes, upper, jaw, motion)
    moved = [replace(s, place=s.place + motion(s.place[None])[0]) if s.jaw else s for s in strokes]
    return CarriedFace(displaced(face, field), tuple(moved))


def displaced(face: ModelFace, field: np.ndarray) -> ModelFace:
    """The face with its skin points moved by a field (n, 3) mm; marks go along, teeth and eyes stay."""

    def along(places):
        places = np.atleast_2d(places)
        nearest = [int(((face.points - place) ** 2).sum(axis=1).argmin()) for place in places]
        return places + field[nearest]

    return replace(
        face,
        points=face.points + field,
        marks={name: along(place)[0] for name, place in face.marks.items()},
        line=along(face.line),
        nostrils=along(face.nostrils),
    )


def _axes(face: ModelFace, s: Skeleton) -> list[np.ndarray]:
    anterior = face.points[face.points[:, 1] < 2]
    half, front = np.abs(anterior[:, 0]).max() + 4, anterior[:, 1].min() - 6
    ends = ((-half, half), (front, 2.0), (s.menton[2] - BELOW, s.nasion[2] + ABOVE))
    return [np.arange(np.floor(a / SPACING), np.floor(b / SPACING) + 1) * SPACING for a, b in ends]


def fit_bone(upper: Field, jaw: Field, face: ModelFace, s: Skeleton) -> list[Stroke]:
    """Raise or dent the bones until the skin is as thick as drawn at the landmarks but the lips and cheeks; strokes.

    There the teeth decide, which stay as they are.
    """
    rays, strokes, done = sites(s, face.marks), [], {}
    for name in [*BRUSHED] * ROUNDS:
        largest = OF_RAMUS if name == "masseter" else LARGEST
        for side, ray in enumerate(rays[name]):
            start = ray.target - 2 * REACH * ray.inward
            skin = first_hit(face.points, face.triangles, start, ray.inward) - REACH
            at = ray.points(STEP)
            values = [field.sample(field.values, at) for field in (upper, jaw)]
            bone = np.flatnonzero(np.minimum(*values) < 0)
            if not len(bone) or not np.isfinite(skin):
                continue
            lower = bool(values[1][bone[0]] < values[0][bone[0]])
            so_far = done.get((name, side), 0.0)
            wanted = so_far + bone[0] * STEP - skin - getattr(s.p, name)
            done[name, side] = float(np.clip(wanted, -largest, largest))
            stroke = Stroke(lower, at[bone[0]], done[name, side] - so_far, SITES[name])
            (jaw if lower else upper).brush([stroke.place], stroke.amount, stroke.width)
            strokes.append(stroke)
    return strokes


def jaw_motion(before: Skeleton, after: Skeleton):
    """Displacement of the mandible between two skeletons, as a function of places (n, 3) mm.

    Thin-plate interpolation of the reference points; the condyles stay.
    """

    def controls(s):
        places = [s.pogonion, s.menton, s.lower_incisor, *(s.gonion_of(side) for side in SIDES)]
        places += [s.condyle_of(side) + [0, 0, up] for side in SIDES for up in (-6, 6)]
        line = np.column_stack([s.arch_lower, s.lower_edge(s.arch_lower[:, 1])])
        share = np.linspace(0, len(line) - 1, 7).round().astype(int)
        return np.array([*places, *line[share], *(line[share] - [0, -4, 16])])

    return RBFInterpolator(controls(before), controls(after) - controls(before), kernel="linear", smoothing=1e-3)


def _carried(face, before, after, axes, upper, jaw, motion) -> np.ndarray:
    """Displacement (n, 3) mm of the points of a face."""
    x, y, z = np.ix_(*axes)
    inside = face_solid(face, axes) | behind_lips(face.line, x, y, z)
    bone = np.minimum(upper.values, jaw.values)
    mouth = oral(before, x, y, z) & (ndimage.distance_transform_edt(inside, sampling=SPACING) > WALL)
    labels = np.where(bone < 0, CRANIUM, np.where(inside & ~mouth, SUPERFICIAL, AIR)).astype(np.uint8)
    origin = np.array([axis[0] for axis in axes])
    mesh = tetrahedralize(labels, np.full(3, SPACING), origin, NODES)
    nodes = np.unique(mesh.boundary_faces()[0])
    place = mesh.points[nodes]
    near_upper, near_jaw = (upper.sample(field.values, place) for field in (upper, jaw))
    touching = np.minimum(near_upper, near_jaw) < CONTACT
    low, high = origin - SPACING / 2, origin + SPACING * (np.array(labels.shape) - 0.5)
    cut = (np.minimum(place - low, high - place) < 0.1).any(axis=1)

    wanted = np.zeros_like(mesh.points)
    lower = near_jaw < near_upper
    shift = after.a_point - before.a_point
    wanted[nodes[lower]] = motion(place[lower])
    wanted[nodes[~lower]] = _maxillary(before, place[~lower])[:, None] * shift
    wanted[nodes[cut]] = 0
    stomion = face.marks["stomion"]
    mouth = (np.abs(place[:, 2] - stomion[2]) < MOUTH) & (place[:, 1] < before.molar_y)
    held, slides = nodes[cut | touching & ~mouth], nodes[touching & mouth & ~cut]
    slope = np.gradient(ndimage.gaussian_filter(bone, 0.7))
    normals = np.column_stack([upper.sample(part, mesh.points[slides]) for part in slope])
    keep = np.linalg.norm(normals, axis=1) > 1e-3
    slides, normals = slides[keep], normals[keep]
    boundary = BoundaryConditions(
        held, wanted[held], [SlidingSet(slides, mesh.points[slides], normals, lambda fraction: RigidMotion())]
    )
    material = neo_hookean(mesh.tissue, {SUPERFICIAL: 4.0}, POISSON)
    solver = ElasticSolver(mesh.points, mesh.cells, material, boundary)
    field = solver.spread(wanted[None])[0]
    solver.close()
    carried = interpolate(face.points, mesh.points, mesh.cells, field)
    return np.round(smoothed(carried, face.triangles), 4)


def _maxillary(s: Skeleton, places: np.ndarray) -> np.ndarray:
    """Share (n,) of the maxilla's motion that upper bone at places (n, 3) has: 1 below the Le Fort I level, 0 above."""
    x, y, z = places.T
    parts = s.cut_height(y) - z, 40 * s.wide - np.abs(x), s.molar_y + 9 - y
    return np.prod([np.clip(part / FADE + 0.5, 0, 1) for part in parts], axis=0)


def smoothed(field: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """A field (n, 3) on the skin's points, averaged with its neighbours a few times; loose points keep theirs."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    both = np.vstack([edges, edges[:, ::-1]])
    links = coo_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(len(field),) * 2).tocsr()
    degree = np.asarray(links.sum(axis=1)).ravel()
    for _ in range(SMOOTHING):
        mean = (links @ field) / np.maximum(degree, 1)[:, None]
        field = np.where(degree[:, None] > 0, 0.5 * (field + mean), field)
    return field
