"""The signed distance to a surface of points and normals."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.compiled import compiled
from pinnochio.errors import InputError


class PointSurface:
    """Implicit surface of oriented points (b, 3) and unit normals (b, 3): a signed distance, positive outside.

    Moving averages, Gaussian with the points' own spacing: of the distances to the points' tangent planes (IMLS),
    which a sphere of radius R misses by -spacing^2/2R, and of the distances to the points along the mean normal, which
    misses by as much on the other side. Half of each is exact on planes and right to third order on curved surfaces.
    The field is smooth, as Newton's method needs it: so many points are averaged, however densely they lie where thin
    bone has two sides, that those left out weigh less than 1e-5.
    """

    WIDTHS = 3.5  # spacings; exp(-3.5^2) < 1e-5

    def __init__(self, points, normals):
        self._points, self._normals = np.asarray(points, float), np.asarray(normals, float)
        if len(self._points) < 8:
            raise InputError("-", "sliding", f"a surface of {len(self._points)} points", "give at least 8 points")
        length = np.linalg.norm(self._normals, axis=1)
        if not (np.isfinite(self._points).all() and np.isfinite(length).all() and (length > 0).all()):
            raise InputError("-", "sliding", "a surface point or normal is not finite", "mend the surface")
        self._normals = self._normals / length[:, None]
        self._tree = cKDTree(self._points)
        spacing = self._tree.query(self._points, 7)[0][:, 1:].mean()
        self._width = max(float(spacing), 1e-6) ** 2
        near = self._tree.query_ball_point(self._points, self.WIDTHS * np.sqrt(self._width), return_length=True)
        self._count = min(int(near.max()) + 1, len(self._points))

    def distance(self, x) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (s,) in mm and its gradient (s, 3) at x (s, 3)."""
        _, near = self._tree.query(x, self._count)
        offset, normals = x[:, None] - self._points[near], self._normals[near]
        square = (offset**2).sum(axis=2)
        weight = np.exp((square[:, :1] - square) / self._width)
        weight /= weight.sum(axis=1, keepdims=True)
        plane = (offset * normals).sum(axis=2)
        first = (weight * plane).sum(axis=1)
        sum_normal, mean_offset = (np.einsum("sk,ski->si", weight, v) for v in (normals, offset))
        # d weight/dx = -2/width weight (offset - mean offset): derivatives of averages are covariances.
        centred = (-2 / self._width) * weight[:, :, None] * (offset - mean_offset[:, None])
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


class CompiledSurface(PointSurface):
    """The same field faster, for surfaces of some hundred points: every point counts whose weight is above 1e-10,
    so that it differs from the other one by what that leaves out, below 1e-5 of a weight."""

    def distance(self, x) -> tuple[np.ndarray, np.ndarray]:
        x = np.ascontiguousarray(x, float)
        value, gradient = np.empty(len(x)), np.empty(x.shape)
        _distances(x, self._points, self._normals, self._width, value, gradient)
        return value, gradient


@compiled
def _distances(x, points, normals, width, value, gradient):
    square, plane = np.empty(len(points)), np.empty(len(points))
    near, weight = np.empty(len(points), np.int64), np.empty(len(points))
    normal, offset = np.empty(3), np.empty(3)
    for s in range(len(x)):
        least, used, total, first = np.inf, 0, 0.0, 0.0
        normal[:], offset[:] = 0.0, 0.0
        for b in range(len(points)):
            a0, a1, a2 = x[s, 0] - points[b, 0], x[s, 1] - points[b, 1], x[s, 2] - points[b, 2]
            square[b] = a0 * a0 + a1 * a1 + a2 * a2
            least = min(least, square[b])
        for b in range(len(points)):
            if square[b] < least + 24 * width:
                near[used], weight[used] = b, np.exp((least - square[b]) / width)
                total += weight[used]
                used += 1
        for k in range(used):
            b = near[k]
            weight[k] /= total
            plane[k] = 0.0
            for i in range(3):
                away = x[s, i] - points[b, i]
                plane[k] += away * normals[b, i]
                normal[i] += weight[k] * normals[b, i]
                offset[i] += weight[k] * away
            first += weight[k] * plane[k]
        length = max(np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), 1e-3)
        second = (normal[0] * offset[0] + normal[1] * offset[1] + normal[2] * offset[2]) / length
        for i in range(3):
            gradient[s, i] = normal[i] * (1 + 1 / length)
        for k in range(used):
            b = near[k]
            # d weight/dx = -2/width weight (offset - mean offset): derivatives of averages are covariances.
            along = plane[k]
            for i in range(3):
                along += normals[b, i] * (offset[i] - second * normal[i] / length) / length
                along += (x[s, i] - points[b, i]) * normal[i] / length
            for i in range(3):
                gradient[s, i] -= 2 / width * weight[k] * (x[s, i] - points[b, i] - offset[i]) * along
        value[s] = (first + second) / 2
        for i in range(3):
            gradient[s, i] /= 2
