"""Soft tissue of a head: from its scan, where no tool labels it, and no deeper than a face needs."""

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

CLIPPED = (1.0, 99.0)  # percentiles of the grey values that air and tissue are told apart on
# Padding: of the scan's border, its share at least; of the voxels in front of it, those that are air, at least [I].
AT_BORDER, BESIDE_AIR = 0.05, 0.2
COARSE, SHIFT = 2.0, 40.0  # mm: grid on which labels are held against the scan, and farthest shift that is tried
CAVITY = 40.0  # cm3; what a bone encloses up to this is bone [I]
OFF, BETTER = 3.5, 1.08  # mm and times the contrast, from which shifted labels fit the scan better [I]


def without_padding(image: sitk.Image) -> tuple[sitk.Image, float | None]:
    """The scan with air where it shows nothing, and the value that stood there, None where it shows all.

    Padding is the commonest single value of the scan's border, all connected voxels of it that meet the border, if
    something else than it is the scan's air: what lies in front of it is darker than the scan's mean of tissue.
    """
    values = sitk.GetArrayFromImage(image)
    sides = np.concatenate([np.take(values, end, axis).ravel() for axis in range(3) for end in (0, -1)])
    listed, counts = np.unique(sides, return_counts=True)
    value = listed[counts.argmax()]
    if counts.max() < AT_BORDER * len(sides):
        return image, None
    coarse = values[tuple(slice(None, None, max(1, round(side / 128))) for side in values.shape)]
    same = coarse == value
    rest = coarse[~same]
    if len(rest) < 1000:
        return image, None
    threshold, air = _otsu(np.clip(rest, *np.percentile(rest, CLIPPED)))
    near = ndimage.binary_dilation(same & _meets_border(same), iterations=2)
    beside = coarse[ndimage.binary_dilation(near) & ~near & ~same]
    if not len(beside) or (beside < threshold).mean() < BESIDE_AIR:
        return image, None
    values[_meets_border(values == value)] = air
    made = sitk.GetImageFromArray(values)
    made.CopyInformation(image)
    return made, float(value)


def _meets_border(mask) -> np.ndarray:
    """The pieces of a mask that reach the border of its volume."""
    pieces, count = ndimage.label(mask)
    sides = [np.take(pieces, end, axis).ravel() for axis in range(mask.ndim) for end in (0, -1)]
    outer = np.zeros(count + 1, bool)
    outer[np.concatenate(sides)] = True
    outer[0] = False
    return outer[pieces]


def check_belongs(grey, bone, spacing: float, refuse) -> None:
    """Refuse a scan [ix, iy, iz] whose bright voxels lie elsewhere than the bone (bool) that is labelled on it.

    The labels are shifted over the scan on a grid of COARSE mm, by a convolution; where they lie, bone must stand out
    of the shell about it nearly as much as anywhere else.
    """
    soft = grey[~ndimage.binary_dilation(bone, iterations=2)]
    if not soft.size or soft.min() == soft.max():
        refuse("it shows nothing but the labelled bone", "give the scan that was segmented, not its labels")
    level = np.percentile(soft, 90), np.percentile(grey[bone], 75)
    if not level[1] > level[0] or grey[bone].mean() <= grey[~bone].mean():
        problem = "the labelled bone is not brighter than the rest of the scan: they do not belong together"
        refuse(problem, "give the scan that was segmented, in its own frame")
    step = max(1, round(COARSE / spacing))
    reach = int(SHIFT / (step * spacing))
    bright = np.clip((grey[::step, ::step, ::step] - level[0]) / (level[1] - level[0]), 0, 1).astype(np.float32)
    mask = bone[::step, ::step, ::step]
    shell = ndimage.binary_dilation(mask, iterations=2) & ~mask
    mask = mask / mask.sum() - shell / max(shell.sum(), 1)
    shape = [side + reach for side in mask.shape]
    product = np.fft.irfftn(np.fft.rfftn(bright, shape) * np.conj(np.fft.rfftn(mask, shape)), shape)
    near = np.r_[0 : reach + 1, -reach:0]
    near_product = product[np.ix_(*[near] * 3)]
    place = np.unravel_index(near_product.argmax(), near_product.shape)
    shift = near[list(place)] * step * spacing
    if np.linalg.norm(shift) > max(OFF, 1.5 * step * spacing) and near_product[place] > BETTER * near_product[0, 0, 0]:
        off, way = np.linalg.norm(shift), ", ".join(f"{value:+.0f}" for value in shift)
        problem = f"the bone that it shows lies {off:.0f} mm from the bone that is labelled ({way} mm in LPS)"
        refuse(problem, "give the scan that was segmented, in its own frame, or put both into one frame")


def air_threshold(volume, bone) -> float:
    """Grey value between air and tissue, by Otsu on what is not bone: of a CT as of a cone-beam CT of any scale.

    volume (nx, ny, nz); bone (nx, ny, nz) bool. The darkest and the brightest per cent (metal) are clipped.
    """
    values = volume[~ndimage.binary_dilation(bone, iterations=2)]
    values = np.clip(values, *np.percentile(values, CLIPPED))
    return _otsu(values)[0]


def _otsu(values) -> tuple[float, float]:
    """Half-way between the two classes of Otsu, where the border of a blurred surface lies; mean of the darker one."""
    image = sitk.GetImageFromArray(values.astype(np.float32).reshape(1, -1))
    otsu = sitk.OtsuThresholdImageFilter()
    otsu.SetNumberOfHistogramBins(256)
    otsu.Execute(image)
    above = values > otsu.GetThreshold()
    dark = float(values[~above].mean())
    return (float(values[above].mean()) + dark) / 2, dark


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


def hollows(bone, voxel: float) -> np.ndarray:
    """What a bone (bool) encloses, up to CAVITY: marrow, a sinus, the inside of a shell; voxel: its volume, mm3."""
    hollow = np.zeros_like(bone)
    for box in ndimage.find_objects(bone.astype(np.uint8)):  # one, or none
        pieces, _ = ndimage.label(ndimage.binary_fill_holes(bone[box]) & ~bone[box])
        small = np.bincount(pieces.ravel()) * voxel <= CAVITY * 1000
        small[0] = False
        hollow[box] = small[pieces]
    return hollow


def larger(mask, voxels: float, structure=None) -> np.ndarray:
    """The connected pieces of a mask of so many voxels at least; structure as of :func:`largest`."""
    pieces, _ = ndimage.label(mask, structure)
    kept = np.bincount(pieces.ravel()) >= voxels
    kept[0] = False
    return kept[pieces]


def between(bone) -> np.ndarray:
    """Voxels with bone on their right and on their left."""
    right = np.maximum.accumulate(bone, axis=0)
    return right & np.maximum.accumulate(bone[::-1], axis=0)[::-1]


def near_skin(head, soft, spacing: float, depth: float, aperture: float, refuse) -> np.ndarray:
    """The largest piece of the soft voxels at most `depth` mm from the skin, on ways through soft tissue.

    The skin is what a ball of diameter `aperture` mm touches from outside: neither nostril nor mouth. Outside is the
    air that meets the front or a side of the scan; the airway meets its lower border.
    """
    air, _ = ndimage.label(~closed(head, aperture / 2 / spacing))
    borders = np.concatenate([air[:, 0].ravel(), air[0].ravel(), air[-1].ravel()])
    outside = np.isin(air, borders[borders > 0])
    start = np.argwhere(ndimage.binary_dilation(outside, iterations=2) & soft)
    if not len(start):
        refuse("no skin lies before outer air", "give a scan of the face with the air before it, in the labels' frame")
    speed = sitk.GetImageFromArray(soft.astype(np.float32))
    reach = depth / spacing
    marched = sitk.FastMarching(speed, start[:, ::-1].tolist(), stoppingValue=reach)
    return largest(soft & (sitk.GetArrayFromImage(marched) <= reach))
