"""What no head looks like, whatever format it comes in: voxels too coarse for bone, a bone that hangs in the air."""

import os

import numpy as np
from scipy import ndimage

from pinnochio.errors import refusal
from pinnochio.model.labels import AIR, CRANIUM, segment_name

COARSEST = 5.0  # mm; slices of CT are no thicker, and plates of bone are thinner already [I]
IN_THE_AIR = 0.95  # share of the voxels round a bone; 0.85 in a model of a face with nothing behind the maxilla [X]


def check_plausible(labels, spacing, segments: tuple[str, ...], case: str, file: str | os.PathLike) -> None:
    """Refuse (InputError) voxels (mm) that are too coarse and bones round which there is nothing but air.

    labels (nx, ny, nz) internal codes.
    """
    refuse = refusal(case, file)
    coarsest = float(np.max(spacing))
    if not coarsest <= COARSEST:
        problem = f"its voxels measure {coarsest:.3g} mm, and bone is thinner"
        refuse(problem, f"segment on a scan of {COARSEST:g} mm or less, or correct the spacing")
    beside = ndimage.generate_binary_structure(3, 1)
    for code, box in enumerate(ndimage.find_objects(labels), 1):
        if box is None or code < CRANIUM:
            continue
        wide = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in box)
        bone = labels[wide] == code
        around = labels[wide][ndimage.binary_dilation(bone, beside) & ~bone]
        share = float((around == AIR).mean()) if len(around) else 0.0
        if not share <= IN_THE_AIR:
            name = segment_name(code - CRANIUM - 1, segments)
            refuse(
                f"{100 * share:.0f} % of what surrounds {name!r} is air: no tissue holds it",
                f"label the tissue round {name!r}, or correct where it lies",
            )
