"""Exact closest points on triangle surfaces."""

from dataclasses import dataclass

import numpy as np
import pyvista as pv


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


def barycentric(queries, corners) -> np.ndarray:
    """Barycentric coordinates (k, 3) of points in the plane of their triangles, corners (k, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    e, f, g = b - a, c - a, queries - a
    ee, ef, ff = (np.einsum("ij,ij->i", x, y) for x, y in ((e, e), (e, f), (f, f)))
    ge, gf = np.einsum("ij,ij->i", g, e), np.einsum("ij,ij->i", g, f)
    area = ee * ff - ef**2
    area = np.where(area > 0, area, 1)
    v, w = (ff * ge - ef * gf) / area, (ee * gf - ef * ge) / area
    return np.stack([1 - v - w, v, w], axis=1)


def closest_on_triangles(points, corners) -> tuple[np.ndarray, np.ndarray]:
    """Closest point (..., 3) of each triangle (..., 3, 3) to a point (..., 3), and its barycentric weights (..., 3)."""
    points = np.broadcast_to(points, corners.shape[:-2] + (3,))
    flat = barycentric(points.reshape(-1, 3), corners.reshape(-1, 3, 3)).reshape(corners.shape[:-1])
    inside = (flat >= 0).all(axis=-1)
    best = np.where(inside[..., None], flat, 0)
    least = np.where(inside, 0, np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, along = corners[..., i, :], corners[..., j, :] - corners[..., i, :]
        length = np.maximum(np.einsum("...x,...x->...", along, along), np.finfo(float).tiny)
        share = np.clip(np.einsum("...x,...x->...", points - start, along) / length, 0, 1)
        away = np.linalg.norm(start + share[..., None] * along - points, axis=-1)
        nearer = ~inside & (away < least)
        weights = np.zeros_like(best)
        weights[..., i], weights[..., j] = 1 - share, share
        best, least = np.where(nearer[..., None], weights, best), np.where(nearer, away, least)
    return np.einsum("...c,...cx->...x", best, corners), best


def _on_border(found, face, points, faces, tolerance: float = 1e-6) -> np.ndarray:
    edges = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]], axis=2)  # edge i lies opposite corner i
    _, inverse, uses = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    open_edge = (uses[inverse] == 1).reshape(-1, 3)
    open_vertex = np.zeros(len(points), bool)
    open_vertex[edges[open_edge]] = True
    weights = barycentric(found, points[faces[face]])
    on_edge = (weights < tolerance) & open_edge[face]
    on_vertex = (weights > 1 - tolerance) & open_vertex[faces[face]]
    return (on_edge | on_vertex).any(axis=1)
