"""Makes a scan of a head whose bones alone are known, with a likely face: `python workflow/fit_face.py --help`."""

import argparse
import sys

import numpy as np
import SimpleITK as sitk
from scipy import ndimage

from pinnochio.errors import InputError
from pinnochio.importing.head_parts import read_bone_parts
from pinnochio.importing.presets import LOWER, LOWER_TEETH, PRESETS, UPPER, UPPER_TEETH
from pinnochio.virtual.fitted_face import fit_face, scan_of

SAMPLES = 3000


def fit_scan(segmentation: str, preset: str, scan: str) -> float:
    """Write the scan of a face fitted round the bones of a tool's segmentation; returns the share of bone inside it."""
    parts, spacing, origin = read_bone_parts(segmentation, "-", preset)
    bone = np.isin(parts, (*UPPER, *LOWER))
    rim = np.argwhere(bone & ~ndimage.binary_erosion(bone)) * spacing + origin
    teeth = {part: np.argwhere(parts == part) * spacing + origin for part in (UPPER_TEETH, LOWER_TEETH)}
    # The face covers what lies in front of the ears: the condyles' middle.
    front = rim[rim[:, 1] < np.percentile(np.argwhere(np.isin(parts, LOWER)) * spacing + origin, 97, axis=0)[1]]
    chosen = front[np.random.default_rng(0).permutation(len(front))[:SAMPLES]]
    fitted = fit_face(chosen, teeth)
    image = sitk.GetImageFromArray(scan_of(fitted, bone, origin, float(spacing)).transpose(2, 1, 0))
    image.SetSpacing([float(spacing)] * 3)
    image.SetOrigin(origin.tolist())
    sitk.WriteImage(image, scan, useCompression=True)
    return fitted.covered


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(description=__doc__)
    made.add_argument("segmentation", help="label map of bones and teeth")
    made.add_argument("scan", help="scan to write: .nii.gz or .nrrd")
    made.add_argument(
        "--preset", default="dentalsegmentator", choices=PRESETS, help="the tool that wrote the label map"
    )
    return made


if __name__ == "__main__":
    options = parser().parse_args()
    try:
        covered = fit_scan(options.segmentation, options.preset, options.scan)
    except InputError as error:
        sys.exit(str(error))
    print(f"{100 * covered:.1f} % of the bone lies inside the face")
