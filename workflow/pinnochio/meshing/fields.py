"""Continuous fields of a label map: where tissue ends, where muscle meets superficial tissue, where thin voids lie."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from pinnochio.compiled import compiled
from pinnochio.model.labels import MUSCLE, SPECK_VOXELS, SUPERFICIAL, TOUCHING

PART = 128  # voxels of a line that are swept at once
SHEET_SHARE = 0.5  # of the closed width: half the thickness that thin sheets get


@dataclass(frozen=True)
class Fields:
    """Fields over a label volume [ix, iy, iz]; spacing and origin (3,) mm; voids up to `thin` mm wide are closed.

    Distances are signed, mm, positive inside, with the surface half-way between voxel centres, and end at `reach` mm.
    """

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    thin: float
    reach: float

    @property
    def low(self) -> np.ndarray:
        """Lower corner (3,) of the volume: the outer side of its first voxel."""
        return self.origin - self.spacing / 2

    @property
    def high(self) -> np.ndarray:
        """Upper corner (3,) of the volume."""
        return self.low + self.spacing * self.labels.shape

    @cached_property
    def is_tissue(self) -> np.ndarray:
        return is_tissue(self.labels)

    @cached_property
    def depth(self) -> np.ndarray:
        """Signed distance to the void, thin voids kept."""
        return self._distance(self.is_tissue)

    @cached_property
    def tissue(self) -> np.ndarray:
        """Signed distance to the void, thin voids closed, smoothed by one voxel."""
        return self._smooth(self._distance(self._closed(self.thin)))

    @cached_property
    def narrow(self) -> np.ndarray:
        """Above zero at and beside voids up to twice `thin` wide, where both sides could be taken for one tissue."""
        narrow = self._closed(2 * self.thin) & ~self.is_tissue
        return ndimage.maximum_filter(narrow.astype(np.float32), 3)

    @cached_property
    def body(self) -> np.ndarray:
        """`tissue`, with sheets thinner than `thin` thickened to it about their middle: what the lattice can show.

        Residues of the opening at convex edges lie less than 0.3 of its radius deep and do not count as sheets.
        """
        core = self.depth > self.thin / 2
        sheet = self.is_tissue & (self.depth > 0.15 * self.thin)
        if core.any():
            sheet &= self._farther(core, self.thin / 2)
        middle = sheet & (self.depth >= ndimage.maximum_filter(self.depth, 3) - 1e-3)
        if not middle.any():
            return self.tissue
        return np.maximum(self.tissue, self._distance(middle) + SHEET_SHARE * self.thin)

    def _closed(self, width: float) -> np.ndarray:
        """Tissue with voids up to `width` mm closed: morphological closing by a ball."""
        far = self.depth < -width / 2
        if not far.any():
            return self.is_tissue
        return self.is_tissue | self._farther(far, width / 2)

    @cached_property
    def muscle(self) -> np.ndarray:
        """Positive where muscle is the nearer tissue, negative where superficial tissue is; zero where they meet."""
        parts = [self.labels == code for code in (MUSCLE, SUPERFICIAL)]
        if not all(part.any() for part in parts):
            return np.full(self.labels.shape, 1e3 if parts[0].any() else -1e3, np.float32)
        muscle, superficial = (self._distance(part) for part in parts)
        return self._smooth((muscle - superficial) / 2)

    @cached_property
    def void(self) -> np.ndarray:
        """1 in voxels that are not tissue, 0 in tissue."""
        return 1 - self.is_tissue.astype(np.float32)

    @cached_property
    def thin_void(self) -> np.ndarray:
        """Centres (v, 3) mm of the void voxels that the closing fills, and half the width (v,) of the void there."""
        index = np.argwhere(~self.is_tissue & (self.tissue > 0))
        half = -self.depth[tuple(index.T)]
        return index * self.spacing + self.origin, half

    def _farther(self, inside, limit: float) -> np.ndarray:
        """Where the surface of a voxel set is more than `limit` mm away, outside."""
        return signed_distance(inside, self.spacing, min(self.reach, limit + 2 * self.spacing.max())) < -limit

    def _distance(self, inside) -> np.ndarray:
        return signed_distance(inside, self.spacing, self.reach)

    def _smooth(self, field) -> np.ndarray:
        return ndimage.gaussian_filter(field, np.prod(self.spacing) ** (1 / 3) / self.spacing, truncate=3)

    def sample(self, field, points) -> np.ndarray:
        """Trilinear value of a field at points (..., 3) mm; constant beyond the outermost voxel centres."""
        points = np.ascontiguousarray(points, float)
        return _trilinear(field, points.reshape(-1, 3), self.origin, self.spacing).reshape(points.shape[:-1])

    def sample_cells(self, field, points, cells, within) -> np.ndarray:
        """Value (m, k) of a field in cells (m, 4) at barycentric coordinates within (k, 4)."""
        return _in_cells(field, points, cells, within, self.origin, self.spacing)

    def filled(self, field, points, cells, within, wanted) -> np.ndarray:
        """Which of the wanted (m,) cells (m, 4) have a field positive at most of the barycentric places within (k, 4).

        Cells farther from its zero than their reach need no look.
        """
        return _filled(field, points, cells, within, wanted, self.origin, self.spacing)

    def clear(self, start, end, steps: int, limit: float) -> np.ndarray:
        """Whether the share of void stays below `limit` on the way from start (n, 3) mm to shortly before end, (n,).

        Looked at in `steps` evenly spaced places, the start among them.
        """
        return _clear(self.void, self.depth, start, end, steps, limit, self.origin, self.spacing)

    def gradient(self, field, points) -> np.ndarray:
        """Gradient (n, 3) of a field by central differences over one voxel."""
        steps = np.diag(self.spacing) / 2
        differences = [self.sample(field, points + step) - self.sample(field, points - step) for step in steps]
        return np.stack(differences, axis=-1) / self.spacing


@compiled
def _trilinear(field, points, origin, spacing):
    values = np.empty(len(points))
    for row in range(len(points)):
        values[row] = _value(field, points[row], origin, spacing)
    return values


@compiled
def _in_cells(field, points, cells, within, origin, spacing):
    values, point = np.empty((len(cells), len(within))), np.empty(3)
    for e in range(len(cells)):
        for k in range(len(within)):
            _inside(points, cells[e], within[k], point)
            values[e, k] = _value(field, point, origin, spacing)
    return values


@compiled
def _filled(field, points, cells, within, wanted, origin, spacing):
    filled, point = np.zeros(len(cells), np.bool_), np.empty(3)
    middle = np.ones(4)
    for e in range(len(cells)):
        if not wanted[e]:
            continue
        cell = cells[e]
        _inside(points, cell, middle, point)
        point /= 4
        reach = 0.0
        for node in cell:
            x, y, z = points[node, 0] - point[0], points[node, 1] - point[1], points[node, 2] - point[2]
            reach = max(reach, np.sqrt(x * x + y * y + z * z))
        value = _value(field, point, origin, spacing)
        filled[e] = value > 0
        if abs(value) < reach:
            positive = k = 0
            while k < len(within) and max(positive, k - positive) <= len(within) // 2:
                _inside(points, cell, within[k], point)
                positive += _value(field, point, origin, spacing) > 0
                k += 1
            filled[e] = 2 * positive > len(within)
    return filled


@compiled
def _inside(points, cell, weights, point):
    """The point (3,) of a cell that has these weights (4,)."""
    for axis in range(3):
        point[axis] = 0.0
        for corner in range(4):
            point[axis] += weights[corner] * points[cell[corner], axis]


@compiled
def _clear(void, depth, start, end, steps, limit, origin, spacing):
    clear = np.ones(len(start), np.bool_)
    point, last = np.empty(3), np.array(void.shape) - 1
    voxel = np.empty(3, np.int64)
    diagonal = np.sqrt((spacing**2).sum())  # so deep in tissue, none of the eight voxels around is void
    for row in range(len(start)):
        length = np.sqrt(((end[row] - start[row]) ** 2).sum()) / steps
        step = 0
        while step < steps:
            for axis in range(3):
                point[axis] = start[row, axis] + step / steps * (end[row, axis] - start[row, axis])
                voxel[axis] = min(max(round((point[axis] - origin[axis]) / spacing[axis]), 0), last[axis])
            deep = depth[voxel[0], voxel[1], voxel[2]]
            if deep <= diagonal and _value(void, point, origin, spacing) >= limit:
                clear[row] = False
                break
            step += 1 + int(max(deep - 2 * diagonal, 0.0) / max(length, 1e-9))
    return clear


@compiled
def _value(field, point, origin, spacing):
    i, right, a = _between(point[0], origin[0], spacing[0], field.shape[0] - 1)
    j, behind, b = _between(point[1], origin[1], spacing[1], field.shape[1] - 1)
    k, above, c = _between(point[2], origin[2], spacing[2], field.shape[2] - 1)
    rest = 1 - c
    return (
        (1 - a) * (1 - b) * (rest * field[i, j, k] + c * field[i, j, above])
        + (1 - a) * b * (rest * field[i, behind, k] + c * field[i, behind, above])
        + a * (1 - b) * (rest * field[right, j, k] + c * field[right, j, above])
        + a * b * (rest * field[right, behind, k] + c * field[right, behind, above])
    )


@compiled
def _between(place, origin, spacing, last):
    place = min(max((place - origin) / spacing, 0.0), float(last))
    lower = min(int(place), max(last - 1, 0))
    return lower, min(lower + 1, last), place - lower


def is_tissue(labels) -> np.ndarray:
    """Where a label map is muscle or superficial tissue."""
    return (labels == MUSCLE) | (labels == SUPERFICIAL)


def without_specks(labels, below: int = SPECK_VOXELS) -> np.ndarray:
    """The label map with connected pieces of one label below `below` voxels turned into the nearest other label."""
    speck = np.zeros(labels.shape, bool)
    for code, box in enumerate(ndimage.find_objects(labels.astype(np.int32) + 1)):
        if box is not None:
            pieces, _ = ndimage.label(labels[box] == code, TOUCHING)
            small = np.bincount(pieces.ravel()) < below
            small[0] = False
            if small.any():
                speck[box] |= small[pieces]
    if not speck.any() or speck.all():
        return labels
    cleaned = labels.copy()
    cleaned[speck] = labels[tuple(nearest_voxels(np.argwhere(speck), ~speck).T)]
    return cleaned


def nearest_voxels(voxels, inside, spacing=(1.0, 1.0, 1.0)) -> np.ndarray:
    """Indices (k, 3) of the voxels of a set that lie nearest to voxels (k, 3) outside it."""
    border = np.argwhere(inside & _beside_other(inside))
    return border[cKDTree(border * spacing).query(voxels * np.asarray(spacing))[1]]


def signed_distance(inside, spacing, reach: float) -> np.ndarray:
    """Distance to the surface of a voxel set, float32 mm, positive inside; exact half-way between voxel centres.

    From `reach` mm on it is `reach`.
    """
    # The mean of the ways to the outermost voxels inside and to the innermost outside is symmetric.
    border, spacing = _beside_other(inside), np.asarray(spacing, float)
    reached = reach + spacing.max() / 2  # the two ways differ by a voxel at most
    with ThreadPoolExecutor(2) as threads:
        distance = sum(threads.map(lambda side: _distance(border & side, spacing, reached), (inside, ~inside))) / 2
    distance = np.minimum(distance, np.float32(reach))
    return np.where(inside, distance, -distance)


def _beside_other(inside) -> np.ndarray:
    """Voxels (nx, ny, nz) bool that share a face with one on the other side of a set's surface."""
    beside = np.zeros(inside.shape, bool)
    for axis in range(3):
        here, line = np.moveaxis(inside, axis, 0), np.moveaxis(beside, axis, 0)
        change = here[1:] != here[:-1]
        line[1:] |= change
        line[:-1] |= change
    return beside


def grown(inside) -> np.ndarray:
    """A voxel set (nx, ny, nz) with all voxels that share a face with it."""
    return inside | _beside_other(inside)


def _distance(seeds, spacing, reach: float) -> np.ndarray:
    """Distance (nx, ny, nz) float32 mm of voxel centres from those of a set; `reach` beyond it."""
    squares, swept = np.empty(seeds.shape, np.float32), np.empty(seeds.shape, np.float32)
    steps = np.ceil(reach / spacing).astype(int)
    _along(seeds.reshape(-1, seeds.shape[2]), spacing[2], reach**2, squares.reshape(-1, seeds.shape[2]))
    _sweep(squares, spacing[1], steps[1], swept)
    squares, swept = swept.reshape(1, len(seeds), -1), squares.reshape(1, len(seeds), -1)
    _sweep(squares, spacing[0], steps[0], swept)
    return np.sqrt(swept).reshape(seeds.shape)


@compiled
def _along(seeds, step, most, squares):
    """Squared distance (r, n) along each row from the nearest seed (r, n) of that row, up to `most`."""
    squares[:] = most
    for row in range(len(seeds)):
        for line in (range(seeds.shape[1]), range(seeds.shape[1] - 1, -1, -1)):
            distance = np.inf
            for place in line:
                distance = 0.0 if seeds[row, place] else distance + step
                squares[row, place] = min(distance**2, squares[row, place])


@compiled
def _sweep(squares, step, steps, swept):
    """Least of squares (r, n, w) and of those up to `steps` places away along n, plus the square of the way to them."""
    rows, count, width = squares.shape
    least = np.empty(count, np.float32)
    for row in range(rows):
        # In parts of w, because most of them are too far from everything to be swept.
        for start in range(0, width, PART):
            end = min(start + PART, width)
            for place in range(count):
                least[place] = np.inf
                for k in range(start, end):  # faster than NumPy's min and max, which look for NaN
                    least[place] = min(least[place], squares[row, place, k])
            for place in range(count):
                line = swept[row, place, start:end]
                most = np.float32(0)
                for k in range(end - start):
                    line[k] = squares[row, place, start + k]
                    most = max(most, line[k])
                for away in range(1, min(steps, count) + 1):
                    added = np.float32((away * step) ** 2)
                    for other in (place - away, place + away):
                        if 0 <= other < count and least[other] + added < most:
                            near = squares[row, other, start:end]
                            for k in range(end - start):
                                line[k] = min(line[k], near[k] + added)
