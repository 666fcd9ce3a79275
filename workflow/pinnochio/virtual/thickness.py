"""Soft-tissue thickness of virtual heads, measured on the labels."""

import numpy as np
from scipy import ndimage

from pinnochio.model.labels import AIR, CRANIUM
from pinnochio.virtual.head import Head
from pinnochio.virtual.published_thickness import PUBLISHED
from pinnochio.virtual.rays import Ray, sites
from pinnochio.virtual.skeleton import Skeleton

STEP = 0.1  # mm along a ray


def along_ray(head: Head, ray: Ray) -> float:
    """Distance (mm) from the first tissue to the first bone along a ray; NaN if it meets no bone.

    Borders between voxels are placed by linear interpolation of the labels' indicators.
    """
    index = ((ray.points(STEP) - head.origin) / head.spacing).T
    low = np.maximum(np.floor(index.min(1)).astype(int) - 1, 0)
    high = np.ceil(index.max(1)).astype(int) + 2
    block = head.labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    borders = []
    for inside in (block != AIR, block >= CRANIUM):
        share = ndimage.map_coordinates(inside.astype(np.float32), index - low[:, None], order=1, mode="nearest")
        hit = np.flatnonzero(share >= 0.5)
        borders.append(hit[0] if len(hit) else np.nan)
    return float((borders[1] - borders[0]) * STEP)


def measure(head: Head) -> dict[str, float]:
    """Thickness (mm) at every landmark of :data:`PUBLISHED`, mean of both sides where there are two; NaN if no bone."""
    s = Skeleton(head.parameters)
    rays = sites(s, head.landmarks)
    return {name: float(np.mean([along_ray(head, ray) for ray in rays[name]])) for name in PUBLISHED}
