"""Faces of persons: a linear model of scanned faces, sampled, and its skin as a solid on a grid.

The model is derived from ICT-FaceKit (MIT licence, beside the file); frame LPS mm, y = 0 between the tragi, z = 0 the
Frankfort horizontal.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.stats import truncnorm

FILE = Path(__file__).parent / "face_model/faces.npz"
LIMIT = 2.5  # standard deviations of an identity's coordinate at most [I]

# Vertices on the midline of the model, and the usual 68 landmarks by their numbers.
NASION, GLABELLA, FOLD, CHIN = 1358, 2015, (5528, 10, 7, 8), (8, 968, 964, 963, 962)
UNDER_CHIN = (962, 966, 965, 969, 2191, 967, 1683, 1733, 961)
PRONASALE, SUBNASALE, SUPERIUS, INFERIUS = 30, 33, 51, 57
CORNERS, WINGS = (54, 48), (35, 31)  # left, right
MOUTH = ((60,), (61, 67), (62, 66), (63, 65), (64,))  # inner lips, right to left; the line runs between them
# What a man's face has more than a woman's: pairs of points, axis, mm [R].
DIMORPHISM = (
    ((16, 0), 0, 7.0),  # across the cheek bones, 68-point numbers
    ((12, 4), 0, 8.0),  # across the jaw
    ((27, 8), 2, 8.0),  # nasal root to chin
    ((33, 30), 1, 2.0),  # subnasale to tip
)


@dataclass(frozen=True)
class FaceModel:
    """mean (n, 3) mm, modes (k, n, 3) mm per standard deviation, triangles (f, 3) of the skin; numbers of points."""

    mean: np.ndarray
    modes: np.ndarray
    triangles: np.ndarray
    corners: np.ndarray
    tragi: np.ndarray
    eyes: np.ndarray
    eye_radius: float
    teeth: dict[str, np.ndarray]
    male: np.ndarray  # (k,) what a man's coordinates have more than a woman's


@dataclass(frozen=True)
class ModelFace:
    """One face: skin points (n, 3) mm and triangles (f, 3), eyeballs, landmarks and teeth by name.

    eyes (2, 3) their centres, eye_radius mm; line (m, 3) between the lips, right to left commissure; nostrils (2, 3)
    their upper ends, left and right; teeth (16, 3) each.
    """

    points: np.ndarray
    triangles: np.ndarray
    eyes: np.ndarray
    eye_radius: float
    marks: dict[str, np.ndarray]
    line: np.ndarray
    nostrils: np.ndarray
    teeth: dict[str, np.ndarray]


@cache
def face_model() -> FaceModel:
    """The model in the repository."""
    with np.load(FILE) as file:
        mean = file["mean"].astype(float)
        modes = file["modes"].astype(float) * file["scales"].astype(float)[:, None, None]
        corners = file["landmarks68"]
        teeth = {name: file[name] for name in ("upper_teeth", "lower_teeth", "upper_edges", "lower_edges")}
        # Smallest change of the coordinates that has the published differences.
        slope = np.array([modes[:, corners[a], axis] - modes[:, corners[b], axis] for (a, b), axis, _ in DIMORPHISM])
        sign = np.array([np.sign(mean[corners[a], axis] - mean[corners[b], axis]) for (a, b), axis, _ in DIMORPHISM])
        wanted = np.array([size for *_, size in DIMORPHISM])
        male = np.linalg.lstsq(slope * sign[:, None], wanted, rcond=None)[0]
        return FaceModel(
            mean,
            modes,
            file["triangles"].astype(np.int64),
            corners,
            file["tragi"],
            file["eyes"],
            float(file["eye_radius"]),
            teeth,
            male,
        )


def sample_identity(rng: np.random.Generator, male: bool) -> tuple[float, ...]:
    """Coordinates of one person of this sex: standard normal within LIMIT over both sexes together."""
    model = face_model()
    half = 0.5 * model.male * (1 if male else -1)
    spread = np.sqrt(np.maximum(1 - half**2, 0.1))
    draws = truncnorm.ppf(rng.random(len(half)), -LIMIT, LIMIT)
    return tuple(np.round(half + spread * draws, 4).tolist())


def make_face(identity) -> ModelFace:
    """The face of an identity (k,), its own tragi at y = 0, its midline at x = 0."""
    model = face_model()
    points = model.mean + np.einsum("k,knx->nx", np.asarray(identity, float), model.modes)
    points -= points[model.tragi].mean(axis=0) * [1, 1, 0]
    corner = points[model.corners]
    chin = points[list(CHIN)]
    pogonion = chin[np.argmin(chin[:, 1])]
    under = points[list(UNDER_CHIN)]
    order = np.argsort(under[:, 1])
    below = pogonion[1] + 17.0  # menton's bone lies so far behind the skin of the chin
    line = np.array([np.mean([corner[i] for i in pair], axis=0) for pair in MOUTH])
    ends = line[[0, -1]] + 0.6 * (corner[[CORNERS[1], CORNERS[0]]] - line[[0, -1]])
    line = np.vstack([ends[:1], line, ends[1:]])
    fold = points[list(FOLD)]
    marks = {
        "glabella": points[GLABELLA],
        "nasion": points[NASION],
        "pronasale": corner[PRONASALE],
        "subnasale": corner[SUBNASALE],
        "labrale_superius": corner[SUPERIUS],
        "stomion": line[3],
        "labrale_inferius": corner[INFERIUS],
        "mentolabial": fold[np.argmax(fold[:, 1])],
        "pogonion_soft": pogonion,
        "menton_soft": np.array([pogonion[0], below, np.interp(below, under[order, 1], under[order, 2])]),
        "cheilion_left": corner[CORNERS[0]],
        "cheilion_right": corner[CORNERS[1]],
        "alare_left": corner[WINGS[0]],
        "alare_right": corner[WINGS[1]],
        "tragus_left": points[model.tragi[0]],
        "tragus_right": points[model.tragi[1]],
        "jaw_left": corner[12],
        "jaw_right": corner[4],
    }
    return ModelFace(
        points,
        model.triangles,
        points[model.eyes],
        model.eye_radius,
        marks,
        line,
        np.array([points[_nostril(side)].mean(axis=0) for side in (1.0, -1.0)]),
        {name: points[index] for name, index in model.teeth.items()},
    )


@cache
def _nostril(side: float) -> np.ndarray:
    """Points at the upper end of a nostril of the mean face."""
    mean = face_model().mean
    x = mean[:, 0] * side
    inside = np.flatnonzero((x > 2) & (x < 14) & (mean[:, 2] > -26.5) & (mean[:, 2] < -8) & (mean[:, 1] > -106))
    inside = inside[mean[inside, 1] < -90]
    return inside[np.argsort(-mean[inside, 2])[:6]]


def solid(points: np.ndarray, triangles: np.ndarray, axes) -> np.ndarray:
    """Grid points inside a skin that is open at the back, bool on the grid (nx, ny, nz).

    A point is inside if a ray to the front meets the skin an odd number of times.
    """
    x, y, z = (np.asarray(axis, float) for axis in axes)
    step = x[1] - x[0]
    shift = step * np.array([1.7e-4, 0, 2.3e-4])  # no ray through a vertex
    corner = (points + shift)[triangles]
    low = np.floor((corner.min(axis=1) - [x[0], 0, z[0]]) / step).astype(int)
    high = np.ceil((corner.max(axis=1) - [x[0], 0, z[0]]) / step).astype(int)
    near = (corner[..., 1].min(axis=1) < y[-1] + step) & (high[:, 0] >= 0) & (low[:, 0] < len(x))
    near &= (high[:, 2] >= 0) & (low[:, 2] < len(z))
    corner, low, high = corner[near], low[near][:, [0, 2]], high[near][:, [0, 2]]
    edges = corner[:, 1:] - corner[:, :1]
    det = edges[:, 0, 0] * edges[:, 1, 2] - edges[:, 0, 2] * edges[:, 1, 0]
    crossings = np.zeros((len(x), len(y) + 1, len(z)), np.int16)
    span = (high - low + 1).max(axis=0)
    for i in range(span[0]):
        for k in range(span[1]):
            column = low + [i, k]
            usable = (column <= high).all(axis=1) & (column >= 0).all(axis=1)
            usable &= (column[:, 0] < len(x)) & (column[:, 1] < len(z)) & (np.abs(det) > 1e-12)
            if not usable.any():
                continue
            index, a, e, d = column[usable], corner[usable, 0], edges[usable], det[usable]
            dx, dz = x[index[:, 0]] - a[:, 0], z[index[:, 1]] - a[:, 2]
            u = (dx * e[:, 1, 2] - dz * e[:, 1, 0]) / d
            v = (dz * e[:, 0, 0] - dx * e[:, 0, 2]) / d
            hit = (u >= 0) & (v >= 0) & (u + v <= 1)
            depth = (a[:, 1] + u * e[:, 0, 1] + v * e[:, 1, 1])[hit]
            row = np.clip(np.ceil((depth - y[0]) / step).astype(int), 0, len(y))
            np.add.at(crossings, (index[hit, 0], row, index[hit, 1]), 1)
    return np.cumsum(crossings[:, :-1], axis=1) % 2 == 1


def face_solid(face: ModelFace, axes) -> np.ndarray:
    """The head of a face, closed at the eyes by the eyeballs; small gaps and specks of the scan conversion mended."""
    inside = solid(face.points, face.triangles, axes)
    x, y, z = np.ix_(*axes)
    for eye in face.eyes:
        inside |= (x - eye[0]) ** 2 + (y - eye[1]) ** 2 + (z - eye[2]) ** 2 < face.eye_radius**2
    return ndimage.median_filter(inside.astype(np.uint8), 3).astype(bool) | (inside & ndimage.binary_erosion(inside))


def first_hit(points: np.ndarray, triangles: np.ndarray, start: np.ndarray, along: np.ndarray) -> float:
    """Distance from `start` (3,) along a unit direction (3,) to the first triangle, NaN if it meets none."""
    corner = points[triangles]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    across = np.cross(along, two)
    det = np.einsum("fx,fx->f", one, across)
    usable = np.abs(det) > 1e-9
    det = np.where(usable, det, 1.0)
    away = start - corner[:, 0]
    turned = np.cross(away, one)
    u = np.einsum("fx,fx->f", away, across) / det
    v = turned @ along / det
    distance = np.einsum("fx,fx->f", two, turned) / det
    hit = usable & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    return float(distance[hit].min()) if hit.any() else np.nan
