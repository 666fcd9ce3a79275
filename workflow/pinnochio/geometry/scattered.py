"""Scattered points: evenly spread choices of them, and values carried to others by the nearest three."""

import numpy as np
from scipy.spatial import cKDTree

NEAREST = 3  # points that a value is interpolated from


def farthest(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of `count` of the points (n, 3), each the farthest from those before it; all of them if fewer."""
    chosen, distance = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def nearest(queries, points) -> tuple[np.ndarray, np.ndarray]:
    """Nearest three of the points for each query, (k, 3) indices, and their shares by the inverse squared distance."""
    distance, index = cKDTree(points).query(queries, np.arange(1, min(NEAREST, len(points)) + 1))
    inverse = 1 / np.maximum(distance, 1e-6) ** 2
    return index, inverse / inverse.sum(axis=1, keepdims=True)


def spread(values, near, weights):
    """Values (k, c) interpolated from those (m, c) of the nearest points (:func:`nearest`), all arrays or tensors."""
    return (values[near] * weights[:, :, None]).sum(1)
