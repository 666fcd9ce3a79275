"""Images of segments: plain label maps, 3D Slicer's `.seg.nrrd` with its names and layers, and DICOM-SEG."""

import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from pinnochio.errors import InputError, Refuse
from pinnochio.geometry.closed_surfaces import read_closed_surface, surface_files, voxelised
from pinnochio.importing.dicom_series import placed
from pinnochio.importing.images import AGAIN, check_places, read_volume

LOG = logging.getLogger(__name__)
HEAD_EXTENT = (50.0, 600.0)  # mm; the longest side of what is labelled lies between
UNITS = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 1e-3}  # mm
MOST = 200  # values of a label map: the tools write 150 at most, a scan has hundreds
SEG_AGAIN = "export the segmentation as one DICOM-SEG file"


@dataclass(frozen=True)
class Segment:
    """One segment of a file: its name and its voxel value or number, None where the format has none.

    voxels() gives its voxels, bool [iz, iy, ix]; segments of one file may overlap; closed: planes that close a surface.
    """

    name: str | None
    value: int | None = None
    voxels: Callable[[], np.ndarray] | None = None
    closed: Sequence[dict] = ()

    def __str__(self) -> str:
        number = "" if self.value is None else f"{self.value:g}"
        return number if self.name is None else repr(self.name) + (number and f" ({number})")


def read_segments(
    path: str | os.PathLike, refuse: Refuse, may_be_empty: bool = False
) -> tuple[sitk.Image, list[Segment]]:
    """The grid of an image (its voxels mean nothing) and its segments, those of a plain label map without names."""
    if str(path).lower().endswith(".dcm") and Path(path).is_file():
        return _read_dicom(path, refuse)
    image = read_volume(path, refuse, layers=True)
    named, channels = image.HasMetaDataKey("Segment0_ID"), image.GetNumberOfComponentsPerPixel()
    values = sitk.GetArrayFromImage(image)
    if values.dtype.kind == "f":
        if not np.isfinite(values).all():
            refuse("it holds NaN or infinite voxels", "replace them by 0 (air)")
        if (values != np.rint(values)).any():
            refuse("it holds values that are not whole numbers", "save the label map, not the scan, as integers")
    listed = () if named else np.unique(values)
    if len(listed) > MOST:
        problem = f"it holds {len(listed)} values, from {listed[0]:g} to {listed[-1]:g}: it is no label map"
        refuse(problem, "save the segmentation itself as a label map, neither the scan nor probabilities")
    if not (values > 0).any() and not may_be_empty:
        refuse("every voxel is 0", "save the label map with the values that 'labels' names")
    if named:
        return image, _slicer_segments(image, values.reshape(*values.shape[:3], channels), refuse)
    if len(listed) and listed[0] < 0:
        LOG.warning("%s: values below 0, as a resampling leaves outside, are air", path)
    return image, [Segment(None, value, lambda value=value: values == value) for value in listed[listed > 0]]


def read_surfaces(folder, direction, refuse: Refuse, head: bool = True) -> tuple[sitk.Image, list[Segment]]:
    """Grid and segments of the surfaces of a folder, each called as its file is; what is open is closed, and said.

    direction: as of :func:`read_closed_surface`; head: whether the largest is a skin.
    """
    files = surface_files(folder, refuse)
    surfaces = {name: read_closed_surface(file, direction, refuse) for name, file in files.items()}
    for name, (*_, closed) in surfaces.items():
        if closed:
            LOG.warning("%s is open; %d planes close it, see segments.png", files[name], len(closed))
    extent = {name: float(np.ptp(points, axis=0).max()) for name, (points, *_) in surfaces.items()}
    check_extent(max(extent.values()), refuse)
    order = sorted(surfaces, key=extent.get, reverse=True)  # the skin is the largest
    image, voxels = voxelised([surfaces[name][:2] for name in order], head)
    masks = dict(zip(order, voxels, strict=True))
    return image, [Segment(name, None, lambda name=name: masks[name], surfaces[name][2]) for name in surfaces]


def check_extent(extent: float | None, refuse: Refuse) -> None:
    """Refuse a head whose longest side (mm) is none."""
    if extent is None or HEAD_EXTENT[0] <= extent <= HEAD_EXTENT[1]:
        return
    likely = [name for name, unit in UNITS.items() if HEAD_EXTENT[0] <= extent * unit <= HEAD_EXTENT[1]]
    unit = " or ".join(likely) or "another unit"
    problem = f"the head measures {extent:.4g} mm; the voxel spacing or the coordinates seem to be in {unit}"
    refuse(problem, "write them in millimetres")


def _slicer_segments(image: sitk.Image, layers: np.ndarray, refuse: Refuse) -> list[Segment]:
    """Segments of a `.seg.nrrd` [iz, iy, ix, layer]; its header holds a name, a value and a layer for each.

    Slicer before 4.11 wrote neither value nor layer: each segment is a layer of zeros and ones.
    """
    header = {key: image.GetMetaData(key) for key in image.GetMetaDataKeys()}
    segments = []
    while (key := f"Segment{len(segments)}_") + "ID" in header:
        name = header.get(key + "Name", header[key + "ID"])
        try:
            value = int(header.get(key + "LabelValue", 1))
            layer = int(header.get(key + "Layer", 0 if key + "LabelValue" in header else len(segments)))
            float(value)
        except (OverflowError, ValueError):
            refuse(f"segment {name!r} has no whole number as value or layer", "save it again in Slicer")
        if not 0 <= layer < layers.shape[3]:
            refuse(f"segment {name!r} lies in layer {layer}, the file has {layers.shape[3]}", "save it again in Slicer")
        segments.append(Segment(name, value, lambda layer=layer, value=value: layers[..., layer] == value))
    return segments


def _read_dicom(path: str | os.PathLike, refuse: Refuse) -> tuple[sitk.Image, list[Segment]]:
    """Grid and segments of a DICOM-SEG; fractional segments count from one half."""
    import highdicom  # half a second, which most stages are spared

    try:
        stored = highdicom.seg.segread(path)
        _check_frames(stored, refuse)
        geometry = stored.get_volume_geometry()
        if geometry is None:
            refuse("its frames are no evenly spaced stack", "export it on the grid of an axial scan without gaps")
        names = {number: stored.get_segment_description(number).segment_label for number in stored.segment_numbers}
        image = sitk.Image([int(n) for n in geometry.spatial_shape[::-1]], sitk.sitkUInt8)
        image = placed(image, geometry.affine)
        check_places([*image.GetOrigin(), *image.GetDirection()], image.GetSpacing(), refuse)
        return image, [Segment(name, number, _voxels(stored, number, refuse)) for number, name in names.items()]
    except InputError:
        raise
    except Exception as error:  # pydicom and highdicom raise what they like
        refuse(f"it cannot be read as DICOM-SEG ({error})", SEG_AGAIN)


def _voxels(stored, number: int, refuse: Refuse) -> Callable[[], np.ndarray]:
    """Reader of the voxels of a segment, of which a file may hold many."""

    def read() -> np.ndarray:
        try:
            return stored.get_volume(segment_numbers=[number]).array[..., 0] >= 0.5
        except Exception as error:
            refuse(f"it cannot be read as DICOM-SEG ({error})", SEG_AGAIN)

    return read


def _check_frames(stored, refuse: Refuse) -> None:
    """Refuse a DICOM-SEG whose frames are not as many as its header says, or show a segment that it does not list."""
    frames, listed = int(stored.NumberOfFrames), stored.PerFrameFunctionalGroupsSequence
    there, wanted = len(stored.PixelData), (frames * stored.Rows * stored.Columns * stored.BitsAllocated + 7) // 8
    # An odd length is filled up; frames that are compressed have lengths of their own.
    whole = stored.file_meta.TransferSyntaxUID.is_encapsulated or wanted <= there <= wanted + 1
    if len(listed) != frames or not whole:
        refuse(
            f"its header asks for {frames} frames in {wanted} bytes; {len(listed)} frames in {there} bytes are there",
            AGAIN,
        )
    if stored.SegmentationType == "LABELMAP":
        return
    shown = {frame.SegmentIdentificationSequence[0].ReferencedSegmentNumber for frame in listed}
    if lost := sorted(shown - set(stored.segment_numbers)):
        refuse(f"it shows segment {lost[0]}, which it does not list", AGAIN)
