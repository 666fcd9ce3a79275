"""Reads what users bring: segmentations, plans and post-operative surfaces, checked, in LPS millimetres."""

import gzip
import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import nibabel
import numpy as np
import pyvista as pv
import SimpleITK as sitk

from pinnochio.anatomy.labels import AIR, TISSUES, internal_codes
from pinnochio.anatomy.plan import Plan
from pinnochio.errors import InputError
from pinnochio.files import replacing

LOG = logging.getLogger(__name__)
IMAGE_FORMATS = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd")
SURFACE_FORMATS = (".ply", ".stl", ".obj", ".vtp")
HEADER = "header"
HEAD_EXTENT = (50.0, 600.0)  # mm; the longest side of what is labelled lies between


@dataclass(frozen=True)
class Segmentation:
    """labels (nx, ny, nz) uint8 internal codes [ix, iy, iz]; spacing (3,) mm; origin (3,) centre of voxel 0, LPS."""

    labels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray


def read_segmentation(
    path: str | os.PathLike,
    case: str,
    label_values: Mapping[str, int],
    segments: Sequence[str],
    orientation: str = HEADER,
) -> Segmentation:
    """Read a label map (NIfTI, NRRD, MHA; any orientation) into internal codes on an axis-aligned LPS grid.

    label_values: voxel value of "superficial", "muscle", "cranium" and of every segment; values that it does not name
    count as air, with a warning. orientation: where the voxel axes of a file with a wrong header point, as a code such
    as "RAS" (first axis to the patient's right, second anterior, third superior). An oblique grid is resampled by
    nearest neighbour on an axis-aligned one of the same spacing. Raises InputError for what the user must mend.
    """

    def refuse(problem: str, remedy: str):
        raise InputError(case, path, problem, remedy)

    image = _read_image(path, refuse)
    if orientation != HEADER:
        direction = np.reshape(sitk.DICOMOrientImageFilter.GetDirectionCosinesFromOrientation(orientation), (3, 3))
        image.SetOrigin(tuple(direction @ np.linalg.inv(np.reshape(image.GetDirection(), (3, 3))) @ image.GetOrigin()))
        image.SetDirection(direction.ravel().tolist())
    values = sitk.GetArrayViewFromImage(image)
    if values.dtype.kind == "f":
        # ITK's NIfTI reader silently turns NaN into 0, so the file is looked at with another one.
        nifti = str(path).lower().endswith((".nii", ".nii.gz"))
        if not np.isfinite(np.asanyarray(nibabel.load(path).dataobj) if nifti else values).all():
            refuse("it holds NaN or infinite voxels", "replace them by 0 (air)")
        if (values != np.rint(values)).any():
            refuse("it holds values that are not whole numbers", "save the label map, not the scan, as integers")
    extent = _labelled_extent(values != 0, image.GetSpacing())
    if extent is None:
        refuse("every voxel is 0", "save the label map with the values that 'labels' names")
    if not HEAD_EXTENT[0] <= extent <= HEAD_EXTENT[1]:
        unit = {-3: "metres", -1: "centimetres", -2: "centimetres", 3: "micrometres"}.get(
            round(np.log10(extent / 200)), "another unit"
        )
        refuse(
            f"the head measures {extent:.4g} mm; the voxel spacing seems to be in {unit}",
            "write the spacing in millimetres",
        )
    image = _axis_aligned(image)
    values = np.ascontiguousarray(sitk.GetArrayFromImage(image).transpose(2, 1, 0))
    labels = np.full(values.shape, AIR, np.uint8)
    for name, code in internal_codes(tuple(segments)).items():
        if name not in label_values:
            refuse(f"the configuration gives no voxel value for {name!r}", f"add {name!r} to 'labels'")
        own = values == label_values[name]
        if not own.any():
            what = "tissue" if name in TISSUES else "bone"
            refuse(
                f"{what} {name!r} (voxel value {label_values[name]}) is empty",
                f"label {name!r} in the segmentation, or correct 'labels' or 'segments' in the configuration",
            )
        labels[own] = code
    known = {AIR, *label_values.values()}
    extra = sorted({float(value) for value in np.unique(values)} - {float(value) for value in known})
    if extra:
        listed = ", ".join(f"{value:g}" for value in extra)
        LOG.warning("case %r: %s: voxel values %s are not named in 'labels'; taken as air", case, path, listed)
    return Segmentation(labels, np.array(image.GetSpacing()), np.array(image.GetOrigin()))


def write_segmentation(labels, spacing, origin, path: str | os.PathLike) -> None:
    """Write labels [ix, iy, iz] as they are, axis-aligned LPS; the same labels give the same bytes."""
    image = sitk.GetImageFromArray(np.ascontiguousarray(np.asarray(labels).transpose(2, 1, 0)))
    image.SetSpacing([float(value) for value in spacing])
    image.SetOrigin([float(value) for value in origin])
    with replacing(path) as temporary:
        if str(path).endswith(".nii.gz"):
            # Compressed here: a gzip header normally holds the time and the name.
            plain = temporary.with_name(temporary.name.removesuffix(".gz"))
            try:
                sitk.WriteImage(image, str(plain))
                temporary.write_bytes(gzip.compress(plain.read_bytes(), compresslevel=6, mtime=0))
            finally:
                plain.unlink(missing_ok=True)
        else:
            sitk.WriteImage(image, str(temporary), useCompression=not str(path).endswith(".nii"))


def read_labels(path: str | os.PathLike) -> Segmentation:
    """Read what :func:`write_segmentation` wrote, without checks."""
    image = _axis_aligned(sitk.ReadImage(str(path)))
    labels = np.ascontiguousarray(sitk.GetArrayFromImage(image).transpose(2, 1, 0)).astype(np.uint8)
    return Segmentation(labels, np.array(image.GetSpacing()), np.array(image.GetOrigin()))


def check_plan(plan: Plan, segments: Sequence[str], path: str | os.PathLike) -> None:
    """Refuse a plan that moves what is not a segment."""
    for name in plan.motions:
        if name not in segments:
            raise InputError(
                plan.case,
                path,
                f"it moves {name!r}, which is not a segment ({', '.join(segments)})",
                f"rename {name!r} in the plan, or add it to 'segments' in the configuration",
            )


def read_postop(path: str | os.PathLike, case: str, skin_points) -> tuple[np.ndarray, np.ndarray]:
    """Read a post-operative skin (PLY, STL, OBJ, VTP): points (p, 3) mm, faces (f, 3) int32, in its own frame.

    Its size is compared with that of the pre-operative skin_points (k, 3) mm, to catch metres and centimetres.
    """

    def refuse(problem: str, remedy: str):
        raise InputError(case, path, problem, remedy)

    if not Path(path).is_file():
        refuse("the file does not exist", "correct the path in the cohort table")
    if not str(path).lower().endswith(SURFACE_FORMATS):
        refuse("this is no surface format known here", f"save it as one of {', '.join(SURFACE_FORMATS)}")
    try:
        # Clean: STL and many scanners repeat the corners of every triangle.
        mesh = pv.read(path)
        if mesh.n_cells:
            mesh = mesh.extract_surface(algorithm="dataset_surface").triangulate()
        points, faces = np.asarray(mesh.points, float), mesh.regular_faces.astype(np.int32)
    except Exception as error:  # the readers raise what they like
        refuse(f"it cannot be read as a surface ({error})", "export the surface again")
    if len(points) == 0 or len(faces) == 0:
        refuse("the surface is empty", "export the skin as triangles")
    if not np.isfinite(points).all():
        refuse("it holds coordinates that are not finite", "remove these vertices and export again")
    points, faces = _merged(points, faces)
    ratio = _diagonal(points) / _diagonal(skin_points)
    for unit, factor in (("metres", 1e-3), ("centimetres", 0.1), ("micrometres", 1e3)):
        if factor / 2.5 < ratio < factor * 2.5:
            refuse(
                f"the surface is {ratio:.3g} times the size of the patient's skin; it seems to be in {unit}",
                f"scale it by {1 / factor:g} to millimetres",
            )
    if not 0.25 < ratio < 4:
        refuse(
            f"the surface is {ratio:.3g} times the size of the patient's skin",
            "give the skin of this patient in millimetres, the whole face and little else",
        )
    return points, faces


def _read_image(path, refuse) -> sitk.Image:
    if not Path(path).is_file():
        refuse("the file does not exist", "correct the path in the cohort table")
    if not str(path).lower().endswith(IMAGE_FORMATS):
        refuse("this is no image format known here", f"save it as one of {', '.join(IMAGE_FORMATS)}")
    try:
        image = sitk.ReadImage(str(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        refuse(f"it cannot be read as an image ({reason})", "export the label map again")
    if image.GetDimension() == 4 and image.GetSize()[3] == 1:
        image = image[..., 0]
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1 or min(image.GetSize()) < 2:
        size = "x".join(map(str, image.GetSize()))
        channels = image.GetNumberOfComponentsPerPixel()
        refuse(f"it is {size} with {channels} channel(s), not a volume", "save one 3-D label map with one channel")
    return image


def _axis_aligned(image: sitk.Image) -> sitk.Image:
    """The image in LPS with the identity as direction; resampled by nearest neighbour only if it is oblique."""
    image = sitk.DICOMOrient(image, "LPS")
    direction = np.array(image.GetDirection()).reshape(3, 3)
    if np.abs(direction - np.eye(3)).max() < 1e-4:  # what float32 headers leave of an identity
        image.SetDirection(np.eye(3).ravel())
        return image
    size, spacing = np.array(image.GetSize()), np.array(image.GetSpacing())
    corners = np.array(np.meshgrid(*[(0, n - 1) for n in size], indexing="ij")).reshape(3, -1).T.tolist()
    places = np.array([image.TransformContinuousIndexToPhysicalPoint(corner) for corner in corners])
    low, high = places.min(axis=0), places.max(axis=0)
    wanted = np.ceil((high - low) / spacing - 1e-6).astype(int) + 1
    grid = [wanted.tolist(), sitk.Transform(), sitk.sitkNearestNeighbor, low.tolist(), spacing.tolist()]
    return sitk.Resample(image, *grid, np.eye(3).ravel().tolist(), 0.0, image.GetPixelID())


def _labelled_extent(inside, spacing) -> float | None:
    """Longest side in mm of the box round the voxels inside [iz, iy, ix]; None if there are none."""
    sides = []
    for axis, step in zip((2, 1, 0), spacing, strict=True):
        found = np.flatnonzero(inside.any(axis=tuple({0, 1, 2} - {axis})))
        if not len(found):
            return None
        sides.append((found[-1] - found[0] + 1) * step)
    return float(max(sides))


def _diagonal(points) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _merged(points, faces) -> tuple[np.ndarray, np.ndarray]:
    """Equal points made one (STL and many scanners repeat the corners of each triangle); no degenerate face."""
    points, renumber = np.unique(points, axis=0, return_inverse=True)
    faces = renumber.ravel()[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[proper], return_inverse=True)
    return points[used], faces.reshape(-1, 3).astype(np.int32)
