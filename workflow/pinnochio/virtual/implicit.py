"""Implicit shapes (negative inside, mm) painted block by block into one scalar field.

A shape is a bounding box with a distance function of broadcastable coordinates; a `Field` evaluates it only where it
can matter, which is what makes a head of sixty shapes cheap.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

F = np.float32
FAR = F(1000)  # mm, where no shape has been near
Coordinates = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Shape:
    """Bounding box `low`, `high` (3,) mm and approximate signed distance `distance(x, y, z)`."""

    low: np.ndarray
    high: np.ndarray
    distance: Callable[..., np.ndarray]


def smooth_minimum(a: np.ndarray, b: np.ndarray, k: float) -> np.ndarray:
    """Minimum of a and b with a quadratic blend of width k mm."""
    if k <= 0:
        return np.minimum(a, b)
    h = np.maximum(F(k) - np.abs(a - b), F(0))
    return np.minimum(a, b) - h * h * F(0.25 / k)


def rounded(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed distance from the corner where the distances a and b to two faces at right angles meet."""
    return np.hypot(np.maximum(a, 0), np.maximum(b, 0)) + np.minimum(np.maximum(a, b), 0)


def ellipsoid(centre, radii, tilt: float = 0.0) -> Shape:
    """Ellipsoid with semi-axes `radii`, turned by `tilt` degrees about the x axis."""
    c, r = np.asarray(centre, F), np.asarray(radii, F)
    cos, sin = F(np.cos(np.radians(tilt))), F(np.sin(np.radians(tilt)))

    def distance(x, y, z):
        x, y, z = x - c[0], y - c[1], z - c[2]
        if tilt:
            y, z = cos * y + sin * z, cos * z - sin * y
        x2, y2, z2 = x * x, y * y, z * z
        k0 = np.sqrt(x2 / r[0] ** 2 + y2 / r[1] ** 2 + z2 / r[2] ** 2)
        k1 = np.sqrt(x2 / r[0] ** 4 + y2 / r[1] ** 4 + z2 / r[2] ** 4)
        return np.where(k1 > 1e-6, k0 * (k0 - 1) / np.maximum(k1, F(1e-6)), -r.min())

    extent = np.array([r[0], max(r[1:]) if tilt else r[1], max(r[1:]) if tilt else r[2]])
    return Shape(c - extent, c + extent, distance)


def tube(points: Sequence, radii: float | Sequence[float]) -> Shape:
    """Union of round cones along a polyline; one radius per point, or one for all."""
    p = np.asarray(points, F)
    r = np.broadcast_to(np.asarray(radii, F), len(p))

    def distance(x, y, z):
        result = None
        for a, b, ra, rb in zip(p[:-1], p[1:], r[:-1], r[1:], strict=True):
            d = b - a
            t = ((x - a[0]) * d[0] + (y - a[1]) * d[1] + (z - a[2]) * d[2]) / max(F(d @ d), F(1e-6))
            t = np.clip(t, 0, 1)
            gap = (x - a[0] - t * d[0]) ** 2 + (y - a[1] - t * d[1]) ** 2 + (z - a[2] - t * d[2]) ** 2
            piece = np.sqrt(gap) - (ra + t * (rb - ra))
            result = piece if result is None else np.minimum(result, piece)
        return result

    return Shape((p - r[:, None]).min(0), (p + r[:, None]).max(0), distance)


def wall(line: np.ndarray, thickness, bottom, top, rounding: float = 2.0) -> Shape:
    """Upright wall along a polyline of the axial plane.

    line (m, 2) mm; half thickness, bottom and top height are scalars or (m,) along the line. The line is sampled
    finely by the caller (about 1 mm): a point takes the values of the nearest sample.
    """
    line = np.asarray(line, F)
    thickness, bottom, top = (np.broadcast_to(np.asarray(v, F), len(line)) for v in (thickness, bottom, top))

    def distance(x, y, z):
        flat = (x[:, :, 0, None] - line[:, 0]) ** 2 + (y[:, :, 0, None] - line[:, 1]) ** 2
        nearest = flat.argmin(-1)
        across = np.sqrt(np.take_along_axis(flat, nearest[..., None], -1)[..., 0])
        across = (across - thickness[nearest] + F(rounding))[:, :, None]
        middle, half = (top + bottom)[nearest] / 2, (top - bottom)[nearest] / 2
        along = np.abs(z - middle[:, :, None]) - half[:, :, None] + F(rounding)
        return rounded(across, along) - F(rounding)

    margin = thickness.max()
    low = [*(line.min(0) - margin), bottom.min()]
    return Shape(np.array(low), np.array([*(line.max(0) + margin), top.max()]), distance)


def plate(polygon: np.ndarray, centre: Callable, thickness: float, rounding: float = 2.0) -> Shape:
    """Plate over a polygon (m, 2) of the sagittal (y, z) plane, around x = centre(y, z), half thickness in mm."""
    corners = np.asarray(polygon, F)

    def outline(y, z):
        best, inside = np.inf, np.zeros(np.broadcast_shapes(y.shape, z.shape), bool)
        for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
            d = b - a
            t = np.clip(((y - a[0]) * d[0] + (z - a[1]) * d[1]) / (d @ d), 0, 1)
            best = np.minimum(best, np.hypot(y - a[0] - t * d[0], z - a[1] - t * d[1]))
            if d[1]:
                inside ^= ((a[1] > z) != (b[1] > z)) & (y < a[0] + (z - a[1]) * d[0] / d[1])
        return np.where(inside, -best, best)

    def distance(x, y, z):
        plan = outline(y, z) + F(rounding)
        across = np.abs(x - centre(y, z)) - F(thickness - rounding)
        return rounded(plan, across) - F(rounding)

    at_corners = centre(corners[:, 0], corners[:, 1])
    low, high = corners.min(0), corners.max(0)
    return Shape(
        np.array([at_corners.min() - thickness, *low]), np.array([at_corners.max() + thickness, *high]), distance
    )


class Field:
    """Scalar field on a regular grid; shapes act only within `reach` mm of their boxes."""

    def __init__(self, axes: Sequence[np.ndarray], reach: float):
        self.axes = [np.asarray(axis, F) for axis in axes]
        self.reach = reach
        self.values = np.full([len(axis) for axis in axes], FAR, F)

    def block(self, low, high) -> tuple[tuple[slice, ...], Coordinates]:
        """Index and open coordinates of the grid points within the box."""
        index = tuple(
            slice(*np.searchsorted(axis, (a, b), side="left")) for axis, a, b in zip(self.axes, low, high, strict=True)
        )
        return index, np.ix_(*(axis[part] for axis, part in zip(self.axes, index, strict=True)))

    def sample(self, values: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Values (nx, ny, nz) on the field's grid, linearly interpolated at points (n, 3) mm."""
        step = [axis[1] - axis[0] for axis in self.axes]
        index = [(column - axis[0]) / h for column, axis, h in zip(points.T, self.axes, step, strict=True)]
        return ndimage.map_coordinates(values, index, order=1, mode="nearest")

    def _near(self, shape: Shape, margin: float):
        index, coordinates = self.block(shape.low - margin, shape.high + margin)
        return index, shape.distance(*coordinates)

    def union(self, *shapes: Shape, k: float = 0.0) -> "Field":
        """Blend shapes in, with a fillet of k mm."""
        for shape in shapes:
            index, d = self._near(shape, self.reach + k)
            self.values[index] = smooth_minimum(self.values[index], d, k)
        return self

    def subtract(self, *shapes: Shape, k: float = 0.0) -> "Field":
        """Carve shapes out, with a rounded rim of k mm."""
        for shape in shapes:
            index, d = self._near(shape, self.reach + k)
            self.values[index] = -smooth_minimum(-self.values[index], d, k)
        return self

    def brush(self, points: Sequence, amplitude: float, width: float) -> "Field":
        """Raise the surface by `amplitude` mm (dent it if negative) along a polyline; Gaussian of `width` mm."""
        points = np.atleast_2d(np.asarray(points, F))
        stroke = tube(np.repeat(points, 2, 0) if len(points) == 1 else points, 0.0)
        index, d = self._near(stroke, 3 * width)
        self.values[index] -= F(amplitude) * np.exp(-((d / F(width)) ** 2))
        return self
