"""Label codes of a segmented head and the names that users give them."""

import numpy as np

AIR = 0
SUPERFICIAL = 1
MUSCLE = 2
CRANIUM = 10
FIRST_SEGMENT = 11
TISSUES = {"superficial": SUPERFICIAL, "muscle": MUSCLE}
TOUCHING = np.ones((3, 3, 3), bool)  # voxels that share a face, an edge or a corner are connected
SPECK_VOXELS = 20  # connected pieces of one label smaller than this are noise [measured on real segmentations]


def segment_code(index: int) -> int:
    """Internal code of the bone segment at `index` of the segment list."""
    return FIRST_SEGMENT + index


def internal_codes(segments: tuple[str, ...]) -> dict[str, int]:
    """Internal code of every structure, by name: the tissues, the cranium and each bone segment."""
    codes = TISSUES | {"cranium": CRANIUM}
    return codes | {name: segment_code(i) for i, name in enumerate(segments)}


def segment_name(index: int, segments: tuple[str, ...]) -> str:
    """Name of a bone by its segment index; -1 is the cranium."""
    return "cranium" if index < 0 else segments[index]
