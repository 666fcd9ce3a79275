"""Soft tissue of a head: from its scan, where no tool labels it, and no deeper than a face needs."""

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.errors import InputError

CLIPPED = (1.0, 99.0)  # percentiles of the grey values that air and tissue are told apart on


def air_threshold(volume, bone) -> float:
    """Grey value between air and tissue, by Otsu on what is not bone: of a CT as of a cone-beam CT of any scale.

    volume (nx, ny, nz); bone (nx, ny, nz) bool. The darkest and the brightest per cent (metal) are clipped.
    """
    values = volume[~ndimage.binary_dilation(bone, iterations=2)]
    values = np.clip(values, *np.percentile(values, CLIPPED))
    image = sitk.GetImageFromArray(values.astype(np.float32).reshape(1, -1))
    otsu = sitk.OtsuThresholdImageFilter()
    otsu.SetNumberOfHistogramBins(256)
    otsu.Execute(image)
    # Half-way between both classes, where the border of a blurred surface lies.
    above = values > otsu.GetThreshold()
    return float((values[above].mean() + values[~above].mean()) / 2)


def bulk(dense, radius: float) -> np.ndarray:
    """The largest piece of the opened mask, with a rim of one voxel that the opening took off."""
    core = largest(morphology(sitk.BinaryMorphologicalOpening, dense, radius))
    return dense & morphology(sitk.BinaryDilate, core, 1)


def closed(mask, radius: float) -> np.ndarray:
    """The mask with gaps narrower than twice `radius` voxels closed."""
    return morphology(sitk.BinaryMorphologicalClosing, mask, radius)


def morphology(filter_, mask, radius: float) -> np.ndarray:
    """Erosion, dilation, opening or closing by a ball of `radius` voxels; the volume goes on beyond its border."""
    radius = int(round(radius))
    padded = sitk.GetImageFromArray(np.pad(mask, radius + 1, mode="edge").astype(np.uint8))
    inner = (slice(radius + 1, -radius - 1),) * 3
    return sitk.GetArrayFromImage(filter_(padded, [radius] * 3))[inner].astype(bool)


def largest(mask, structure=None) -> np.ndarray:
    """The largest connected piece of a mask; structure (3, 3, 3) bool: what is connected, by default by a face."""
    pieces, count = ndimage.label(mask, structure)
    return pieces == 1 + np.argmax(np.bincount(pieces.ravel())[1:]) if count else mask


def between(bone) -> np.ndarray:
    """Voxels with bone on their right and on their left."""
    right = np.maximum.accumulate(bone, axis=0)
    return right & np.maximum.accumulate(bone[::-1], axis=0)[::-1]


def near_skin(head, soft, spacing: float, depth: float, aperture: float, file: object = "CT") -> np.ndarray:
    """The largest piece of the soft voxels at most `depth` mm from the skin, on ways through soft tissue.

    The skin is what a ball of diameter `aperture` mm touches from outside: neither nostril nor mouth. Outside is the
    air that meets the front or a side of the scan; the airway meets its lower border.
    """
    air, _ = ndimage.label(~closed(head, aperture / 2 / spacing))
    borders = np.concatenate([air[:, 0].ravel(), air[0].ravel(), air[-1].ravel()])
    outside = np.isin(air, borders[borders > 0])
    start = np.argwhere(ndimage.binary_dilation(outside, iterations=2) & soft)
    if not len(start):
        raise InputError("-", file, "no skin lies in front of outer air", "lower 'skin', or give more of the scan")
    speed = sitk.GetImageFromArray(soft.astype(np.float32))
    reach = depth / spacing
    marched = sitk.FastMarching(speed, start[:, ::-1].tolist(), stoppingValue=reach)
    return largest(soft & (sitk.GetArrayFromImage(marched) <= reach))
