"""Values carried from scattered points to others, by the nearest three."""

import numpy as np
from scipy.spatial import cKDTree

NEAREST = 3  # points that a value is interpolated from


def nearest(queries, points) -> tuple[np.ndarray, np.ndarray]:
    """Nearest three of the points for each query, (k, 3) indices, and their shares by the inverse squared distance."""
    distance, index = cKDTree(points).query(queries, np.arange(1, min(NEAREST, len(points)) + 1))
    inverse = 1 / np.maximum(distance, 1e-6) ** 2
    return index, inverse / inverse.sum(axis=1, keepdims=True)


def spread(values, near, weights):
    """Values (k, c) interpolated from those (m, c) of the nearest points (:func:`nearest`), all arrays or tensors."""
    return (values[near] * weights[:, :, None]).sum(1)
