"""The signed distance to a surface of points and normals."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.errors import InputError


class PointSurface:
    """Implicit surface of oriented points (b, 3) and unit normals (b, 3): a signed distance, positive outside.

    Moving averages, Gaussian with the points' own spacing: of the distances to the points' tangent planes (IMLS),
    which a sphere of radius R misses by -spacing^2/2R, and of the distances to the points along the mean normal, which
    misses by as much on the other side. Half of each is exact on planes and right to third order on curved surfaces.
    The field is smooth, as Newton's method needs it: so many points are averaged, however densely they lie where thin
    bone has two sides, that those left out weigh less than 1e-5.
    width: squared spacing, mm2; count: how many points.
    """

    WIDTHS = 3.5  # spacings; exp(-3.5^2) < 1e-5

    def __init__(self, points, normals):
        self.points, self.normals = np.asarray(points, float), np.asarray(normals, float)
        if len(self.points) < 8:
            raise InputError("-", "sliding", f"a surface of {len(self.points)} points", "give at least 8 points")
        length = np.linalg.norm(self.normals, axis=1)
        if not (np.isfinite(self.points).all() and np.isfinite(length).all() and (length > 0).all()):
            raise InputError("-", "sliding", "a surface point or normal is not finite", "mend the surface")
        self.normals = self.normals / length[:, None]
        self._tree = cKDTree(self.points)
        spacing = self._tree.query(self.points, 7)[0][:, 1:].mean()
        self.width = max(float(spacing), 1e-6) ** 2
        near = self._tree.query_ball_point(self.points, self.WIDTHS * np.sqrt(self.width), return_length=True)
        self.count = min(int(near.max()) + 1, len(self.points))

    def distance(self, x) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (s,) in mm and its gradient (s, 3) at x (s, 3)."""
        _, near = self._tree.query(x, self.count)
        offset, normals = x[:, None] - self.points[near], self.normals[near]
        square = (offset**2).sum(axis=2)
        weight = np.exp((square[:, :1] - square) / self.width)
        weight /= weight.sum(axis=1, keepdims=True)
        plane = (offset * normals).sum(axis=2)
        first = (weight * plane).sum(axis=1)
        sum_normal, mean_offset = (np.einsum("sk,ski->si", weight, v) for v in (normals, offset))
        # d weight/dx = -2/width weight (offset - mean offset): derivatives of averages are covariances.
        centred = (-2 / self.width) * weight[:, :, None] * (offset - mean_offset[:, None])
        grad_first = sum_normal + np.einsum("sk,skj->sj", plane, centred)
        turn, drift = (np.einsum("ski,skj->sij", v, centred) for v in (normals, offset))
        length = np.maximum(np.linalg.norm(sum_normal, axis=1), 1e-3)[:, None]
        normal = sum_normal / length
        second = (normal * mean_offset).sum(axis=1)
        across = (mean_offset - second[:, None] * normal) / length
        grad_second = normal + np.einsum("sij,si->sj", turn, across) + np.einsum("sij,si->sj", drift, normal)
        return (first + second) / 2, (grad_first + grad_second) / 2

    def project(self, x, level, iterations: int = 200) -> np.ndarray:
        """x (s, 3) moved along the gradient to where the signed distance is `level` (s,), to 1e-9 mm if it can."""
        x = np.array(x, float)
        active = np.arange(len(x))
        for _ in range(iterations):
            value, gradient = self.distance(x[active])
            gap = level[active] - value
            left = np.abs(gap) > 1e-9
            active, gap, gradient = active[left], gap[left], gradient[left]
            if not len(active):
                break
            step = gradient * (gap / np.maximum((gradient**2).sum(axis=1), 0.01))[:, None]
            # A step is never longer than 2 mm: across a sharp edge the gradient says little about what lies beyond.
            x[active] += step * np.minimum(1, 2 / np.maximum(np.linalg.norm(step, axis=1), 1e-30))[:, None]
        return x
