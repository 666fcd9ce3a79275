"""Triangles in NumPy alone: normals, areas, samples, volume, closest points."""

import numpy as np


def face_normals(points, faces) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (f, 3), zero on degenerate faces, and areas (f,) mm2."""
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return cross / np.where(length > 0, length, 1)[:, None], length / 2


def vertex_normals(points, faces) -> np.ndarray:
    """Area-weighted unit normals (p, 3); zero on points without a face."""
    normals, areas = face_normals(points, faces)
    around = (normals * areas[:, None]).T
    total = np.stack([np.bincount(faces.T.ravel(), np.tile(axis, 3), len(points)) for axis in around], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1)


def corner_sums(faces, values, count: int) -> np.ndarray:
    """Sum (count,) over the triangles around each point of a third of their values (f,)."""
    return np.bincount(faces.ravel(), np.repeat(values / 3, 3), count)


def vertex_areas(points, faces) -> np.ndarray:
    """Area (p,) mm2 that belongs to each vertex: a third of its triangles."""
    return corner_sums(faces, face_normals(points, faces)[1], len(points))


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


def enclosed_volume(points, faces) -> float:
    """Volume in mm3 that a closed surface encloses, positive if its faces look outward."""
    a, b, c = np.moveaxis(points[faces] - points.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


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
