"""Parts the bones of a CT that nobody has segmented, by a threshold and three planes: a start, to be looked at.

python workflow/segment_ct.py SCAN PATIENT --planes planes.mrk.json --bone 300

PATIENT becomes a folder with the scan and its label map on one grid, as `labels: dentalsegmentator` reads them.
"""

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from pinnochio.errors import InputError, refusal
from pinnochio.files import replacing
from pinnochio.geometry.plane import Plane
from pinnochio.importing.head_parts import read_scan
from pinnochio.importing.markups import read_markups
from pinnochio.importing.presets import MANDIBLE, SKULL
from pinnochio.importing.segmentation import HEADER, plain_name, write_segmentation
from pinnochio.importing.soft_tissue import bulk, closed, larger

PLANES = ("occlusal", "pterygoid", "joint")
HOLES, MARGIN = 3.0, 8.0  # mm: half the width of holes that are closed; in front of the pterygoid plane, still unsure
LOOSE = 5000.0  # mm3: bone that hangs on nothing and is smaller is none: hyoid, larynx


def segment_ct(ct: str, planes: str, bone: float, folder: str, orientation: str = HEADER, spacing: float = 1.0) -> None:
    """Write `ct.nii.gz` and `segmentation.nii.gz` (1 skull, 2 mandible) to the folder, in cubes of spacing mm, LPS.

    bone: lowest grey value of bone; orientation: where the voxel axes point, if the header is wrong. Raises InputError.
    """
    refuse, scan = refusal("-", ct), Path(folder, "ct.nii.gz")
    if scan.exists() and scan.samefile(ct):
        refuse("the scan that is made would take its place", "name another folder")
    image = _cubes(sitk.DICOMOrient(read_scan(ct, orientation, "-", refuse), "LPS"), spacing, refuse)
    known = {plain_name(name): plane for name, plane in read_markups([planes], "-").planes.items()}
    if missing := [name for name in PLANES if name not in known]:
        refusal("-", planes)(f"it has no plane {missing[0]!r}", f"draw planes called {', '.join(PLANES)}")
    parts = part_bones(image, known, bone, refuse)
    os.makedirs(folder, exist_ok=True)
    with replacing(scan) as temporary:
        sitk.WriteImage(image, str(temporary))
    write_segmentation(parts, image.GetSpacing(), image.GetOrigin(), Path(folder, "segmentation.nii.gz"))


def part_bones(image: sitk.Image, planes: Mapping[str, Plane], bone: float, refuse) -> np.ndarray:
    """SKULL (with the upper jaw), MANDIBLE and 0 of a scan in cubes along LPS, uint8 [ix, iy, iz].

    A watershed parts the bones where they are least dense, at the joints. It starts from bone more than MARGIN in front
    of the plane `pterygoid` (normal back), above and below `occlusal` (normal up), and from bone above `joint` (up).
    """
    density, spacing = sitk.GetArrayFromImage(image).transpose(2, 1, 0), image.GetSpacing()[0]
    axes = [image.GetOrigin()[axis] + spacing * np.arange(side) for axis, side in enumerate(density.shape)]
    heights = {}
    for name in PLANES:
        from_plane = zip(axes, planes[name].point, planes[name].normal, strict=True)
        heights[name] = sum(np.ix_(*((axis - point) * normal for axis, point, normal in from_plane)))
    bony = density > bone
    jaws = bony & (heights["pterygoid"] < -MARGIN)
    markers = np.zeros(density.shape, np.uint8)
    markers[jaws & (heights["occlusal"] <= 0)] = MANDIBLE
    markers[jaws & (heights["occlusal"] > 0) | bony & (heights["joint"] > 0)] = SKULL
    if missing := {SKULL: "above", MANDIBLE: "below"}.keys() - set(np.unique(markers[jaws])):
        side = "above" if SKULL in missing else "below"
        refuse(f"there is no bone {side} the occlusal plane", "correct the planes or the threshold of bone")
    flooded = sitk.MorphologicalWatershedFromMarkers(
        *(sitk.GetImageFromArray(np.ascontiguousarray(array)) for array in (-density, markers)), markWatershedLine=False
    )
    lower = bulk(bony & (sitk.GetArrayFromImage(flooded) == MANDIBLE), 1)
    upper = closed(larger(bony & ~lower, LOOSE / spacing**3), HOLES / spacing) & ~lower
    lower = closed(lower, HOLES / spacing) & ~upper
    return np.where(lower, MANDIBLE, np.where(upper, SKULL, 0)).astype(np.uint8)


def _cubes(image: sitk.Image, spacing: float, refuse) -> sitk.Image:
    if not np.allclose(image.GetDirection(), np.eye(3).ravel(), atol=1e-4):
        refuse("its axes are oblique", "resample it to axes along the body, or name the axes")
    extent = (np.array(image.GetSize()) - 1) * image.GetSpacing()
    return sitk.Resample(
        image,
        size=[int(side) + 1 for side in extent / spacing + 1e-6],
        outputOrigin=image.GetOrigin(),
        outputSpacing=[spacing] * 3,
        defaultPixelValue=float(sitk.GetArrayViewFromImage(image).min()),
    )


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("ct", metavar="SCAN", help="CT: NRRD, NIfTI, MHA, or the folder of a DICOM series")
    options.add_argument("folder", metavar="PATIENT", help="folder that is made")
    options.add_argument("--planes", required=True, help=f"markups of 3D Slicer with the planes {', '.join(PLANES)}")
    options.add_argument("--bone", type=float, required=True, help="lowest grey value of bone")
    options.add_argument("--orientation", default=HEADER, help="where the voxel axes point, such as LPI")
    options.add_argument("--spacing", type=float, default=1.0, help="edge of the voxels that are made, mm")
    try:
        segment_ct(**vars(options.parse_args()))
    except InputError as error:
        sys.exit(str(error))
