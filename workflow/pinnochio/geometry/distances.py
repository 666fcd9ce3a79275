"""Seeded samples of triangle surfaces, the areas of their vertices, and distances between them."""

import numpy as np

from pinnochio.geometry.closest_points import Closest, closest_points, signed_distances
from pinnochio.geometry.triangles import face_normals

__all__ = ["Closest", "closest_points", "sample_surface", "signed_distances", "vertex_areas"]


def sample_surface(points, faces, count: int, seed: int) -> np.ndarray:
    """`count` points (count, 3) spread uniformly over the area of the triangles; the same for the same seed."""
    random = np.random.default_rng(seed)
    areas = np.cumsum(face_normals(points, faces)[1])
    chosen = np.searchsorted(areas, random.random(count) * areas[-1], side="right")
    u, v = random.random((2, count))
    fold = u + v > 1
    u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
    a, b, c = np.moveaxis(points[faces[np.minimum(chosen, len(faces) - 1)]], 1, 0)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a)


def vertex_areas(points, faces) -> np.ndarray:
    """Area (p,) mm2 that belongs to each vertex: a third of its triangles."""
    thirds = np.repeat(face_normals(points, faces)[1] / 3, 3)
    return np.bincount(faces.ravel(), thirds, minlength=len(points))
