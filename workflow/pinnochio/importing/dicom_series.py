"""A scan as DICOM: a folder with the slices of one series, or with one file that holds them all."""

import logging
import os
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from pinnochio.errors import Refuse

LOG = logging.getLogger(__name__)
FEWEST = 10  # slices of a scan; localizers and reports have fewer
UNEVEN = 0.03  # of the distance of two slices by which another may differ
TILTED = 0.2  # degrees between the way of the slices and their normal from which they are resampled
AGAIN = "copy the whole series again from where it comes from"
WORDS = ("SeriesInstanceUID", "SeriesDescription", "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing")
WORDS += ("Rows", "Columns", "BitsAllocated", "SamplesPerPixel", "ImageType", "Modality", "NumberOfFrames")


def read_series(path: str | os.PathLike, refuse: Refuse) -> sitk.Image:
    """The volume (float32, rescaled) of a folder of slices, whatever their names.

    Refused are several series, another grid within one, slices that are missing, there twice, cut off or at uneven
    distances. Of a tilted gantry the slices are resampled on an upright grid, and that is said.
    """
    import pydicom  # a quarter of a second, which other formats are spared

    path = Path(path)
    series: dict[str, list] = {}
    files = (file for file in sorted(path.rglob("*")) if file.is_file()) if path.is_dir() else [path]
    for file in files:
        try:
            head = pydicom.dcmread(file, stop_before_pixels=True, specific_tags=list(WORDS))
            frames = int(head.get("NumberOfFrames") or 1) > 1 and head.get("Modality") != "SEG"
            if (frames or "ImagePositionPatient" in head) and "LOCALIZER" not in (head.get("ImageType") or ()):
                series.setdefault(str(head.get("SeriesInstanceUID")), []).append((file, head))
        except pydicom.errors.InvalidDicomError:
            continue
        except Exception as error:  # pydicom raises what it likes
            refuse(f"{file.name!r} cannot be read ({error})", AGAIN)
    whole = [one for one in series.values() if sum(int(head.get("NumberOfFrames") or 1) for _, head in one) >= FEWEST]
    if len(whole) != 1:
        listed = [f"{slices[0][1].get('SeriesDescription') or 'no name'} ({len(slices)})" for slices in whole]
        held = ", ".join(listed[:8]) or "none of " + f"{FEWEST} slices or more"
        problem = f"it holds {len(whole)} series of a scan: {held}"
        refuse(problem, "keep all slices of the one that was segmented, in a folder")
    return _of_slices(whole[0], refuse) if len(whole[0]) > 1 else _of_frames(whole[0][0][0], refuse)


def _of_frames(file: Path, refuse: Refuse) -> sitk.Image:
    """The volume of a file of many frames, in whatever order they lie."""
    import highdicom

    try:
        volume = highdicom.imread(file).get_volume(dtype=np.float32)
    except Exception as error:  # pydicom and highdicom raise what they like
        refuse(f"its frames are no evenly spaced volume ({error})", AGAIN)
    return placed(sitk.GetImageFromArray(volume.array), volume.affine)


def placed(image: sitk.Image, affine: np.ndarray) -> sitk.Image:
    """The image where an affine (4, 4) of highdicom has it, LPS mm."""
    steps = affine[:3, 2::-1]  # highdicom counts slice, row, column; ITK counts column, row, slice
    lengths = np.linalg.norm(steps, axis=0)
    image.SetSpacing(lengths.tolist())
    image.SetDirection((steps / lengths).ravel().tolist())
    image.SetOrigin(affine[:3, 3].tolist())
    return image


def _of_slices(slices: list, refuse: Refuse) -> sitk.Image:
    try:
        grids = {
            (tuple(np.round([*head.ImageOrientationPatient, *head.PixelSpacing], 4)), int(head.Rows), int(head.Columns))
            for _, head in slices
        }
        places = np.array([head.ImagePositionPatient for _, head in slices], float).reshape(len(slices), 3)
        least = [
            0 if head.file_meta.TransferSyntaxUID.is_compressed else head.Rows * head.Columns * head.BitsAllocated // 8
            for _, head in slices
        ]
        ((*cosines, height, width), _, _), *others = grids
        across, down = np.reshape(cosines, (2, 3))
        normal = np.cross(across, down)
        if not min(height, width) > 1e-6 or not 0.99 < np.linalg.norm(normal) < 1.01:
            raise ValueError(f"axes {cosines}, pixels of {height} x {width} mm")
    except (AttributeError, TypeError, ValueError) as error:
        refuse(f"a slice does not say where it lies, or how large it is ({error})", AGAIN)
    if others:
        refuse(f"its slices lie on {len(grids)} grids", "keep the slices of one volume")
    for (file, _), size in zip(slices, least, strict=True):
        if file.stat().st_size < size:
            refuse(f"its slice {file.name!r} is cut off", AGAIN)
    order = np.argsort(places @ normal, kind="stable")
    places = places[order]
    steps = np.diff(places, axis=0)
    distance = float(np.median(steps @ normal))
    if (steps @ normal < 0.1 * distance).any() or not distance > 1e-3:
        refuse("two of its slices lie at one place", "keep the slices of one volume")
    gaps = np.flatnonzero(steps @ normal > 1.5 * distance)
    if len(gaps):
        missing = int(np.round(steps[gaps] @ normal / distance - 1).sum())
        refuse(f"{missing} slices are missing, the first at {places[gaps[0]][2] + distance:.1f} mm (z)", AGAIN)
    step = (places[-1] - places[0]) / len(steps)
    if np.linalg.norm(steps - step, axis=1).max() > UNEVEN * distance + 0.01:
        off = np.linalg.norm(steps - step, axis=1).max()
        refuse(f"its slices lie at uneven distances (by {off:.2f} of {distance:.2f} mm)", "resample it evenly")
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames([str(slices[index][0]) for index in order])
    reader.SetOutputPixelType(sitk.sitkFloat32)
    try:
        image = reader.Execute()
    except RuntimeError as error:
        refuse(f"its slices cannot be read ({str(error).strip().splitlines()[-1]})", AGAIN)
    image.SetSpacing([width, height, distance])
    image.SetOrigin(places[0].tolist())
    image.SetDirection(np.column_stack([across, down, normal]).ravel().tolist())
    return _upright(image, step / distance - normal)


def _upright(image: sitk.Image, shear: np.ndarray) -> sitk.Image:
    """The volume of slices that shift by `shear` (3,) mm for each mm along their normal, on a grid that does not."""
    tilt = float(np.degrees(np.arctan(np.linalg.norm(shear))))
    if tilt <= TILTED:
        return image
    axes, size, spacing = np.reshape(image.GetDirection(), (3, 3)), np.array(image.GetSize()), image.GetSpacing()
    LOG.warning("the gantry was tilted by %.1f degrees; the slices are resampled upright", tilt)
    shift = shear @ axes[:, :2] * spacing[2] * (size[2] - 1)  # of the last slice, along rows and columns
    more = np.ceil(np.abs(shift) / spacing[:2]).astype(int)
    start = np.minimum(shift, 0)
    back = sitk.AffineTransform(3)
    back.SetMatrix((np.eye(3) - np.outer(shear, axes[:, 2])).ravel().tolist())
    back.SetCenter(image.GetOrigin())
    return sitk.Resample(
        image,
        size=[int(size[0] + more[0]), int(size[1] + more[1]), int(size[2])],
        transform=back,
        interpolator=sitk.sitkLinear,
        outputOrigin=(np.array(image.GetOrigin()) + axes[:, :2] @ start).tolist(),
        outputSpacing=spacing,
        outputDirection=image.GetDirection(),
        defaultPixelValue=float(sitk.GetArrayViewFromImage(image).min()),
    )
