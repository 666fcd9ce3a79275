"""Continuous fields of a label map: where tissue ends, where muscle meets superficial tissue, where thin voids lie."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.compiled import compiled
from pinnochio.model.labels import MUSCLE, SPECK_VOXELS, SUPERFICIAL, TOUCHING

SHEET_SHARE = 0.5  # of the closed width: half the thickness that thin sheets get


@dataclass(frozen=True)
class Fields:
    """Fields over a label volume [ix, iy, iz]; spacing and origin (3,) mm; voids up to `thin` mm wide are closed.

    Distances are signed, mm, positive inside, with the surface half-way between voxel centres.
    """

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    thin: float

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
        return signed_distance(self.is_tissue, self.spacing)

    @cached_property
    def tissue(self) -> np.ndarray:
        """Signed distance to the void, thin voids closed, smoothed by one voxel."""
        return self._smooth(signed_distance(self._closed(self.thin), self.spacing))

    @cached_property
    def narrow(self) -> np.ndarray:
        """Above zero at and beside voids up to twice `thin` wide, where both sides could be taken for one tissue."""
        narrow = self._closed(2 * self.thin) & ~self.is_tissue
        return ndimage.binary_dilation(narrow, TOUCHING).astype(np.float32)

    @cached_property
    def body(self) -> np.ndarray:
        """`tissue`, with sheets thinner than `thin` thickened to it about their middle: what the lattice can show.

        Residues of the opening at convex edges lie less than 0.3 of its radius deep and do not count as sheets.
        """
        core = self.depth > self.thin / 2
        sheet = self.is_tissue & (self.depth > 0.15 * self.thin)
        if core.any():
            sheet &= signed_distance(core, self.spacing) < -self.thin / 2
        middle = sheet & (self.depth >= ndimage.maximum_filter(self.depth, 3) - 1e-3)
        if not middle.any():
            return self.tissue
        return np.maximum(self.tissue, signed_distance(middle, self.spacing) + SHEET_SHARE * self.thin)

    def _closed(self, width: float) -> np.ndarray:
        """Tissue with voids up to `width` mm closed: morphological closing by a ball."""
        far = self.depth < -width / 2
        if not far.any():
            return self.is_tissue
        return self.is_tissue | (signed_distance(far, self.spacing) < -width / 2)

    @cached_property
    def muscle(self) -> np.ndarray:
        """Positive where muscle is the nearer tissue, negative where superficial tissue is; zero where they meet."""
        parts = [self.labels == code for code in (MUSCLE, SUPERFICIAL)]
        if not all(part.any() for part in parts):
            return np.full(self.labels.shape, 1e3 if parts[0].any() else -1e3, np.float32)
        muscle, superficial = (signed_distance(part, self.spacing) for part in parts)
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

    def _smooth(self, field) -> np.ndarray:
        return ndimage.gaussian_filter(field, np.prod(self.spacing) ** (1 / 3) / self.spacing, truncate=3)

    def sample(self, field, points) -> np.ndarray:
        """Trilinear value of a field at points (..., 3) mm; constant beyond the outermost voxel centres."""
        points = np.ascontiguousarray(points, float)
        return _trilinear(field, points.reshape(-1, 3), self.origin, self.spacing).reshape(points.shape[:-1])

    def clear(self, field, start, end, steps: int, limit: float) -> np.ndarray:
        """Whether a field stays below `limit` on the way from start (n, 3) mm to shortly before end (n, 3), (n,).

        Looked at in `steps` evenly spaced places, the start among them.
        """
        return _clear(field, start, end, steps, limit, self.origin, self.spacing)

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
def _clear(field, start, end, steps, limit, origin, spacing):
    clear = np.ones(len(start), np.bool_)
    point = np.empty(3)
    for row in range(len(start)):
        for step in range(steps):
            for axis in range(3):
                point[axis] = start[row, axis] + step / steps * (end[row, axis] - start[row, axis])
            if _value(field, point, origin, spacing) >= limit:
                clear[row] = False
                break
    return clear


@compiled
def _value(field, point, origin, spacing):
    i, right, a = _between(point[0], origin[0], spacing[0], field.shape[0] - 1)
    j, behind, b = _between(point[1], origin[1], spacing[1], field.shape[1] - 1)
    k, above, c = _between(point[2], origin[2], spacing[2], field.shape[2] - 1)
    total = 0.0
    for corner in range(8):
        x, u = (right, a) if corner & 1 else (i, 1 - a)
        y, v = (behind, b) if corner & 2 else (j, 1 - b)
        z, w = (above, c) if corner & 4 else (k, 1 - c)
        total += u * v * w * field[x, y, z]
    return total


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
    for code in np.unique(labels):
        pieces, _ = ndimage.label(labels == code, TOUCHING)
        small = np.bincount(pieces.ravel()) < below
        small[0] = False
        speck |= small[pieces]
    if not speck.any() or speck.all():
        return labels
    nearest = ndimage.distance_transform_edt(speck, return_distances=False, return_indices=True)
    return labels[tuple(nearest)]


def signed_distance(inside, spacing) -> np.ndarray:
    """Distance to the surface of a voxel set, float32 mm, positive inside; exact half-way between voxel centres."""

    def distance(mask):
        image = sitk.GetImageFromArray(mask.astype(np.uint8))
        image.SetSpacing([float(s) for s in spacing[::-1]])
        field = sitk.SignedMaurerDistanceMap(image, squaredDistance=False, useImageSpacing=True)
        return sitk.GetArrayFromImage(field)

    # Maurer's distance is zero on the outermost voxels inside; the mean of both sides is symmetric.
    return (distance(~inside) - distance(inside)) / 2
