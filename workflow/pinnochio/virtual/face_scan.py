"""What a camera would see of a face after surgery: a noisy, partial surface in a frame of its own."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pinnochio.geometry.mesh_topology import pieces
from pinnochio.geometry.triangles import face_normals, vertex_normals
from pinnochio.plans.plan import RigidMotion

# Cameras of a stereophotogrammetry rig look from 45 degrees left and right, slightly from below [R].
CAMERAS = np.array([[0.70, -0.70, -0.14], [-0.70, -0.70, -0.14]])
CAMERAS /= np.linalg.norm(CAMERAS, axis=1)[:, None]
RIM = 6.0  # mm lost along the outer border [I]
CORRELATION = 8.0  # mm, length of the smooth part of the noise [I]
SMOOTH_SHARE = 0.83  # of the noise's SD is smooth, 0.55 white: their squares add to one [I]
HOLE_RADIUS = (2.0, 5.0)  # mm [I]
SHIFT, ANGLE = 8.0, 6.0  # mm per axis and degrees by which the frame is off at most [I]


@dataclass(frozen=True)
class Scan:
    """points (n, 3) mm in the scanner's frame, faces (m, 3) int32; frame: patient -> scanner; vertex (n,) source."""

    points: np.ndarray
    faces: np.ndarray
    frame: RigidMotion
    vertex: np.ndarray


def outer_border(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertices of the longest open border; the mouth and the nostrils are shorter ones."""
    edges, count = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1), axis=0, return_counts=True)
    edges = edges[count == 1]
    if not len(edges):
        return np.zeros(0, int)
    loop = pieces(edges, len(points))[edges[:, 0]]
    length = np.bincount(loop, np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1))
    return np.unique(edges[loop == length.argmax()])


def smooth_noise(points: np.ndarray, rng: np.random.Generator, length: float, waves: int = 200) -> np.ndarray:
    """Gaussian field (n,) of unit variance whose correlation falls as exp(-(d / length)^2 / 2)."""
    direction = rng.normal(size=(waves, 3)) / length
    phase = rng.uniform(0, 2 * np.pi, waves)
    return np.sqrt(2 / waves) * np.cos(points @ direction.T + phase) @ rng.normal(size=waves)


def largest_patch(faces: np.ndarray, count: int) -> np.ndarray:
    """Triangles of the connected patch that has most of them."""
    patch = pieces(faces, count)[faces[:, 0]]
    return faces[patch == np.bincount(patch).argmax()]


def seen(points: np.ndarray, faces: np.ndarray, coverage: float) -> np.ndarray:
    """Triangles (m,) bool that face a camera with at least this cosine and lie off the outer rim."""
    facing = (face_normals(points, faces)[0] @ CAMERAS.T).max(1) > coverage
    border = outer_border(points, faces)
    if not len(border):
        return facing
    near = cKDTree(points[border]).query(points, distance_upper_bound=RIM)[0] < RIM
    return facing & ~near[faces].any(1)


def pierced(points: np.ndarray, faces: np.ndarray, holes: int, rng: np.random.Generator) -> np.ndarray:
    """Triangles (m,) bool that no hole takes away."""
    keep = np.ones(len(faces), bool)
    for _ in range(holes):
        centre = points[faces[rng.integers(len(faces)), 0]]
        radius = rng.uniform(*HOLE_RADIUS)
        keep &= ~(np.linalg.norm(points - centre, axis=1) < radius)[faces].any(1)
    return keep


def misaligned(rng: np.random.Generator, multiple: float, pivot: np.ndarray) -> RigidMotion:
    """Motion from the patient's frame to the scanner's."""
    axis = rng.normal(size=3)
    angle = multiple * rng.uniform(0.3, 1.0) * ANGLE
    rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle, degrees=True).as_matrix()
    return RigidMotion(rotation, multiple * rng.uniform(-SHIFT, SHIFT, 3), pivot)


def scan(
    points: np.ndarray,
    faces: np.ndarray,
    rng: np.random.Generator,
    noise: float = 0.3,
    holes: int = 6,
    coverage: float | None = 0.15,
    frame: float = 1.0,
) -> Scan:
    """Scan a skin surface.

    points (n, 3), faces (m, 3) outward; noise: SD in mm along the normals, smooth and white; holes: how many; coverage:
    see :func:`seen`, None sees everything; frame: multiple of the usual misalignment. Vertices come in random order, so
    that nothing but geometry ties the scan to its source. The same generator draws the same scan whatever is off.
    ValueError if nothing is left.
    """
    points, faces = np.asarray(points, float), np.asarray(faces)
    draws = [np.random.default_rng(seed) for seed in rng.integers(2**63, size=4)]
    kept = faces if coverage is None else faces[seen(points, faces, coverage)]
    if not len(kept):
        raise ValueError("nothing of the surface is left: no triangle faces the cameras away from its border")
    kept = largest_patch(kept[pierced(points, kept, holes, draws[0])], len(points))
    white = np.sqrt(1 - SMOOTH_SHARE**2) * draws[1].normal(size=len(points))
    offset = noise * (white + SMOOTH_SHARE * smooth_noise(points, draws[1], CORRELATION))
    motion = misaligned(draws[2], frame, points.mean(0))
    vertex = draws[3].permutation(np.unique(kept))
    index = np.full(len(points), -1)
    index[vertex] = np.arange(len(vertex))
    noisy = points + offset[:, None] * vertex_normals(points, faces)
    return Scan(motion.apply(noisy[vertex]), draws[3].permutation(index[kept]).astype(np.int32), motion, vertex)
