"""Exact closest points on triangle surfaces."""

from dataclasses import dataclass, field
from functools import cached_property

import igl
import numpy as np

from pinnochio.geometry.triangles import barycentric


@dataclass(frozen=True)
class Closest:
    """Closest points (k, 3) mm on a surface, distance (k,) mm, face (k,); surface: points (p, 3), faces (f, 3)."""

    points: np.ndarray
    distance: np.ndarray
    face: np.ndarray
    surface: tuple[np.ndarray, np.ndarray] = field(repr=False)

    @cached_property
    def border(self) -> np.ndarray:
        """Whether each closest point (k,) lies on an open border."""
        return _on_border(self.weights, self.face, *self.surface)

    @cached_property
    def weights(self) -> np.ndarray:
        """Barycentric coordinates (k, 3) of the closest points in their faces."""
        points, faces = self.surface
        return barycentric(self.points, points[faces[self.face]])

    def carried(self, moved) -> np.ndarray:
        """Where the closest points (k, 3) mm are when those of the surface have moved (p, 3) mm."""
        return np.einsum("kc,kcx->kx", self.weights, np.asarray(moved)[self.surface[1][self.face]])


def closest_points(queries, points, faces) -> Closest:
    """Exact closest point of each query (k, 3) on the triangles points (p, 3), faces (f, 3)."""
    queries, points, faces = _as_igl(queries, points, faces)
    if not len(queries):
        return Closest(queries, np.zeros(0), np.zeros(0, int), (points, faces))
    _, face, closest = igl.point_mesh_squared_distance(queries, points, faces)
    distance = np.linalg.norm(queries - closest, axis=1)
    return Closest(closest, distance, face, (points, faces))


def signed_distances(queries, points, faces) -> np.ndarray:
    """Distance (k,) mm to an outward surface, positive in front of it (outside), negative behind."""
    queries, points, faces = _as_igl(queries, points, faces)
    if not len(queries):
        return np.zeros(0)
    return igl.signed_distance(queries, points, faces, igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)[0]


def _as_igl(queries, points, faces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As libigl takes them."""
    queries, points = np.ascontiguousarray(queries, float), np.ascontiguousarray(points, float)
    return queries, points, np.ascontiguousarray(faces, np.int64)


def _on_border(weights, face, points, faces, tolerance: float = 1e-6) -> np.ndarray:
    edges = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]], axis=2).astype(np.int64)  # edge i lies opposite corner i
    key = edges[..., 0] * len(points) + edges[..., 1]
    _, inverse, uses = np.unique(key.ravel(), return_inverse=True, return_counts=True)
    open_edge = (uses[inverse] == 1).reshape(-1, 3)
    open_vertex = np.zeros(len(points), bool)
    open_vertex[edges[open_edge]] = True
    on_edge = (weights < tolerance) & open_edge[face]
    on_vertex = (weights > 1 - tolerance) & open_vertex[faces[face]]
    return (on_edge | on_vertex).any(axis=1)
