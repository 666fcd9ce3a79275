"""What a camera would see of a face after surgery: a noisy, partial surface in a frame of its own."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pinnochio.anatomy.plan import RigidMotion

# Cameras of a stereophotogrammetry rig look from 45 degrees left and right, slightly from below [R].
CAMERAS = np.array([[0.70, -0.70, -0.14], [-0.70, -0.70, -0.14]])


@dataclass(frozen=True)
class Scan:
    """points (n, 3) mm in the scanner's frame, faces (m, 3) int32; frame: patient -> scanner; vertex (n,) source."""

    points: np.ndarray
    faces: np.ndarray
    frame: RigidMotion
    vertex: np.ndarray


def face_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Twice the area times the unit normal of each triangle, (m, 3)."""
    a, b, c = points[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def vertex_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area-weighted unit normals (n, 3); zero where no triangle meets."""
    normals = np.zeros_like(points)
    np.add.at(normals, faces.ravel(), np.repeat(face_normals(points, faces), 3, 0))
    return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]


def border_vertices(faces: np.ndarray) -> np.ndarray:
    """Vertices on edges that belong to one triangle only."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    return np.unique(edges[count == 1])


def smooth_noise(points: np.ndarray, rng: np.random.Generator, length: float, waves: int = 200) -> np.ndarray:
    """Gaussian field (n,) of unit variance whose correlation falls as exp(-(d / length)^2 / 2)."""
    direction = rng.normal(size=(waves, 3)) / length
    phase = rng.uniform(0, 2 * np.pi, waves)
    return np.sqrt(2 / waves) * np.cos(points @ direction.T + phase) @ rng.normal(size=waves)


def largest_patch(faces: np.ndarray, count: int) -> np.ndarray:
    """Triangles of the connected patch that has most of them."""
    i, j = faces[:, [0, 1]].T.ravel(), faces[:, [1, 2]].T.ravel()
    _, part = connected_components(coo_matrix((np.ones(len(i)), (i, j)), (count, count)), directed=False)
    own = part[faces[:, 0]]
    return faces[own == np.bincount(own).argmax()]


def scan(
    points: np.ndarray,
    faces: np.ndarray,
    rng: np.random.Generator,
    noise_mm: float = 0.15,
    correlated_mm: float = 0.25,
    correlation_mm: float = 8.0,
    border_mm: float = 6.0,
    grazing: float = 0.15,
    max_shift_mm: float = 8.0,
    max_angle_deg: float = 6.0,
) -> Scan:
    """Scan a skin surface.

    points (n, 3), faces (m, 3) outward. White and correlated noise (SD in mm, correlation length in mm) act along the
    normals: sub-0.5 mm in all, as published for stereophotogrammetry [R]. Triangles that no camera sees (cosine below
    `grazing`) and those within `border_mm` of the surface's border are lost [I]. The frame is off by up to
    `max_shift_mm` per axis and `max_angle_deg` [I]; vertices come in random order, so that nothing but geometry ties
    the scan to its source.
    """
    points, faces = np.asarray(points, float), np.asarray(faces)
    normals = vertex_normals(points, faces)
    facing = face_normals(points, faces)
    facing /= np.maximum(np.linalg.norm(facing, axis=1), 1e-12)[:, None]
    views = CAMERAS / np.linalg.norm(CAMERAS, axis=1)[:, None]
    keep = (facing @ views.T).max(1) > grazing
    border = border_vertices(faces)
    if len(border) and border_mm > 0:
        near = cKDTree(points[border]).query(points, distance_upper_bound=border_mm)[0] < border_mm
        keep &= ~near[faces].any(1)
    if not keep.any():
        raise ValueError("nothing of the surface is left: no triangle faces the cameras away from its border")
    seen = largest_patch(faces[keep], len(points))
    offset = noise_mm * rng.normal(size=len(points)) + correlated_mm * smooth_noise(points, rng, correlation_mm)
    axis = rng.normal(size=3)
    angle = rng.uniform(0.3, 1.0) * max_angle_deg
    rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle, degrees=True).as_matrix()
    frame = RigidMotion(rotation, rng.uniform(-max_shift_mm, max_shift_mm, 3), points.mean(0))
    vertex = rng.permutation(np.unique(seen))
    index = np.full(len(points), -1)
    index[vertex] = np.arange(len(vertex))
    noisy = points + offset[:, None] * normals
    return Scan(frame.apply(noisy[vertex]), rng.permutation(index[seen]).astype(np.int32), frame, vertex)


def lip_change(
    points: np.ndarray,
    landmarks: dict[str, np.ndarray],
    upper_mm: float = 0.8,
    lower_mm: float = 1.0,
    alar_mm: float = 1.0,
    reach_mm: float = 8.0,
    weight: np.ndarray | None = None,
) -> np.ndarray:
    """Systematic change of lips and nasal base after surgery that no rigid plan contains, (n, 3) mm.

    The upper lip flattens (`upper_mm` back, a third of it down) after the vestibular incision [I]; the lower lip, no
    longer strained, curls in (`lower_mm`, half back and half up) [S: KIM16/19 name it; the size is I]; each
    wing of the nose moves `alar_mm` sideways: +4 mm of width in all after Le Fort I advance [S: PMC6173856], of which
    the mechanics already gives a part, so a half is the default [I]. Gaussian around the landmarks with SD `reach_mm`;
    `weight` (n,) scales it, zero on bone.
    """
    left, right = landmarks["cheilion_left"], landmarks["cheilion_right"]
    wing = np.array([0.34 * np.linalg.norm(left - right), 4.0, 4.0])  # from subnasale to the wing
    sites = [
        (landmarks["labrale_superius"], upper_mm * np.array([0, 1, -1 / 3])),
        (landmarks["labrale_inferius"], lower_mm * np.array([0, 0.5, 0.5])),
        (landmarks["subnasale"] + wing, alar_mm * np.array([1, 0, 0])),
        (landmarks["subnasale"] + wing * [-1, 1, 1], alar_mm * np.array([-1, 0, 0])),
    ]
    change = np.zeros((len(points), 3))
    for centre, push in sites:
        stretch = np.array([0.5, 1, 1]) if push[0] == 0 else np.ones(3)  # lips are wide, wings are not
        distance = np.sum(((points - centre) * stretch / reach_mm) ** 2, 1)
        change += np.exp(-0.5 * distance)[:, None] * push
    return change if weight is None else change * np.asarray(weight)[:, None]
