"""Exact closest points on triangle surfaces."""

from dataclasses import dataclass

import numpy as np
import pyvista as pv

from pinnochio.anatomy.triangles import barycentric


@dataclass(frozen=True)
class Closest:
    """Closest points (k, 3) mm on a surface, distance (k,) mm, face (k,), border (k,) bool: on an open border."""

    points: np.ndarray
    distance: np.ndarray
    face: np.ndarray
    border: np.ndarray


def closest_points(queries, points, faces) -> Closest:
    """Exact closest point of each query (k, 3) on the triangles points (p, 3), faces (f, 3)."""
    points, faces = np.asarray(points, float), np.asarray(faces)
    queries = np.asarray(queries, float)
    if not len(queries):
        return Closest(queries, np.zeros(0), np.zeros(0, int), np.zeros(0, bool))
    mesh = pv.PolyData.from_regular_faces(points, faces)
    face, found = mesh.find_closest_cell(queries, return_closest_point=True)
    face, found = np.atleast_1d(face), np.atleast_2d(found)
    distance = np.linalg.norm(queries - found, axis=1)
    return Closest(found, distance, face, _on_border(found, face, points, faces))


def signed_distances(queries, points, faces) -> np.ndarray:
    """Distance (k,) mm to an outward surface, positive in front of it (outside), negative behind."""
    cloud = pv.PolyData(np.asarray(queries, float))
    surface = pv.PolyData.from_regular_faces(np.asarray(points, float), faces)
    return np.array(cloud.compute_implicit_distance(surface)["implicit_distance"])


def _on_border(found, face, points, faces, tolerance: float = 1e-6) -> np.ndarray:
    edges = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]], axis=2).astype(np.int64)  # edge i lies opposite corner i
    key = edges[..., 0] * len(points) + edges[..., 1]
    _, inverse, uses = np.unique(key.ravel(), return_inverse=True, return_counts=True)
    open_edge = (uses[inverse] == 1).reshape(-1, 3)
    open_vertex = np.zeros(len(points), bool)
    open_vertex[edges[open_edge]] = True
    weights = barycentric(found, points[faces[face]])
    on_edge = (weights < tolerance) & open_edge[face]
    on_vertex = (weights > 1 - tolerance) & open_vertex[faces[face]]
    return (on_edge | on_vertex).any(axis=1)
