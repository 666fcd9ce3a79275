"""Formats of volumes, and how many voxels one has by its header alone: what memory and time of its import go by."""

import gzip
import math
import os
import re
import struct
import zlib
from pathlib import Path

from pinnochio.files import entries

IMAGE_FORMATS = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".gipl", ".gipl.gz", ".dcm")
HEADER = 4096  # bytes that hold the sizes in every format


def voxels(path: str | os.PathLike) -> int:
    """Voxels of a NIfTI, NRRD or MetaImage file; 0 where nobody can say, as of a file that is not there yet."""
    try:
        name = str(path).lower()
        with open(path, "rb") as file:  # compressed or not, by its content
            packed = name.endswith((".nii", ".nii.gz")) and file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else open(path, "rb") as file:
            head = file.read(HEADER)
        if name.endswith((".nii", ".nii.gz")):
            order = next(order for order in "<>" if struct.unpack(order + "i", head[:4])[0] in (348, 540))
            old = struct.unpack(order + "i", head[:4])[0] == 348
            sides = struct.unpack_from(order + ("4h" if old else "4q"), head, 40 if old else 16)[1:]
        else:
            sides = [int(word) for word in re.search(rb"^(?:sizes:|DimSize *=)(.*)$", head, re.MULTILINE)[1].split()]
        return max(0, math.prod(sides))
    except (OSError, EOFError, StopIteration, TypeError, ValueError, struct.error, zlib.error):
        return 0


def millions(path: str | os.PathLike) -> int:
    """Its voxels in millions, rounded up; of a folder of surfaces, which become voxels of 1 mm, 0."""
    return 0 if Path(path).is_dir() else math.ceil(voxels(path) / 1e6)


def is_image(path: str | os.PathLike) -> bool:
    """Whether a path is a label map, or a folder of label maps."""
    path = Path(path)
    files = entries(path) if path.is_dir() else [path]
    return any(file.name.lower().endswith(IMAGE_FORMATS) for file in files)
