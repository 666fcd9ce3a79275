"""Repairs what segmentations are rarely free of: stray voxels, fragments, small holes."""

import logging

import numpy as np
from scipy import ndimage

from pinnochio.errors import InputError
from pinnochio.model.labels import AIR, MUSCLE, SPECK_VOXELS, SUPERFICIAL, TOUCHING, internal_codes, segment_code

LOG = logging.getLogger(__name__)
LARGEST_HOLE = 500.0  # mm3; more enclosed air is the mouth, an airway or a sinus [I]
KEPT = "enclosed cavity kept"
COMPARABLE = 0.2  # a piece of this share of the largest one is no fragment [I]


def repair(
    labels, segments: tuple[str, ...], limit_percent: float, case: str, file: object, voxel: float = 1.0
) -> tuple[np.ndarray, list[dict]]:
    """The label map without stray voxels, fragments and holes, and a statement of each repair.

    labels (nx, ny, nz) internal codes; voxel: volume of a voxel, mm3. Voxels that share a face, an edge or a corner
    are connected. These pieces take the label of most of the sound voxels around them, again until nothing is left to
    repair:

    - pieces of any label below SPECK_VOXELS (salt and pepper);
    - all pieces of a bone segment but the largest, and all pieces of soft tissue (muscle and superficial taken
      together) but the largest. Cranium and either tissue alone may be in pieces: the volume cuts them, and muscles
      are many;
    - enclosed air of up to LARGEST_HOLE: pieces of air that do not reach the border of the volume. Larger cavities
      (mouth, airway, sinus) are kept and stated.

    A statement has `structure`, `what` and `voxels`. A clean map comes back with the same bytes. Raises InputError
    where a segment or the soft tissue is in two pieces of comparable size, and where the repairs would add to or take
    from a structure more than `limit_percent` of its voxels.
    """
    raw, labels = np.asarray(labels), np.array(labels)
    names = {code: name for name, code in internal_codes(tuple(segments)).items()} | {AIR: "air"}
    statements = []
    while True:
        faults = _faults(labels, tuple(segments), LARGEST_HOLE / voxel, case, file)
        every = np.logical_or.reduce(list(faults.values()))
        # Each round joins whole pieces to others, so their number falls until none is left to repair.
        if not every.any() or every.all():
            break
        before = labels.copy()
        _absorb(labels, every)
        for what, mask in faults.items():
            pairs, counts = np.unique(np.stack([before[mask], labels[mask]]), axis=1, return_counts=True)
            for (old, new), voxels in zip(pairs.T, counts, strict=True):
                statements.append(_statement(names[old], f"{what} to {names[new]}", voxels))
    for code, name in names.items():
        was, now = raw == code, labels == code
        changed, size = int((was != now).sum()), int(was.sum())
        if code != AIR and not 100 * changed <= limit_percent * size:
            problem = f"stray voxels, fragments and holes make up {100 * changed / max(size, 1):.3g} % of {name!r} "
            problem += f"({changed} of {size} voxels; the limit is {limit_percent:g} %)"
            raise InputError(case, file, problem, f"clean {name!r} in the segmentation, or raise 'repair.limit'")
    piece, size = _pieces(labels == AIR)
    kept = np.sort(size[_enclosed(piece, size)])[::-1]
    statements += [_statement("air", KEPT, voxels) for voxels in kept]
    for statement in statements:
        LOG.info("case %r: %s: %s, %d voxels", case, *statement.values())
    return labels, statements


def repaired_voxels(statements: list[dict]) -> int:
    """Voxels that the stated repairs changed."""
    return sum(statement["voxels"] for statement in statements if statement["what"] != KEPT)


def _statement(structure: str, what: str, voxels) -> dict:
    return {"structure": structure, "what": what, "voxels": int(voxels)}


def _faults(labels, segments, largest_hole, case, file) -> dict[str, np.ndarray]:
    """Voxels to repair (nx, ny, nz) bool by kind of fault; no voxel has two."""
    stray, fragments, holes = (np.zeros(labels.shape, bool) for _ in range(3))
    boxes = ndimage.find_objects(labels)  # no piece reaches beyond the box of its label
    every = tuple(slice(None) for _ in labels.shape)
    for code, box in enumerate([every, *boxes]):  # the first is AIR, 0
        if box is None:
            continue
        piece, size = _pieces(labels[box] == code)
        small = size < SPECK_VOXELS
        if small.any():
            stray[box] |= small[piece]
        if code == AIR:
            hole = _enclosed(piece, size) & (size <= largest_hole) & ~small
            if hole.any():
                holes |= hole[piece]
    codes = {name: (segment_code(index),) for index, name in enumerate(segments)}
    codes["soft tissue"] = (SUPERFICIAL, MUSCLE)
    for name, group in codes.items():
        extents = [boxes[code - 1] for code in group if code <= len(boxes) and boxes[code - 1] is not None]
        if not extents:
            continue
        box = tuple(
            slice(min(side.start for side in sides), max(side.stop for side in sides))
            for sides in zip(*extents, strict=True)
        )
        piece, size = _pieces(np.isin(labels[box], group) if len(group) > 1 else labels[box] == group[0])
        pieces = np.argsort(-size[1:], kind="stable") + 1
        if len(pieces) < 2:
            continue
        largest, second = size[pieces[:2]]
        if second >= max(COMPARABLE * largest, SPECK_VOXELS):
            remedy = f"join them, or label two segments, such as {name}_left and {name}_right"
            if name == "soft tissue":
                remedy = "join them in the segmentation: the face must be one body"
            raise InputError(case, file, f"{name!r} is in pieces of {largest} and {second} voxels", remedy)
        fragments[box] |= np.isin(piece, pieces[1:])
    return {"stray voxels": stray, "fragment": fragments & ~stray, "hole": holes}


def _pieces(mask) -> tuple[np.ndarray, np.ndarray]:
    """Number of the connected piece of each voxel (0 outside) and the size of each; that of piece 0 counts as huge."""
    piece, _ = ndimage.label(mask, TOUCHING)
    size = np.bincount(piece.ravel())
    size[0] = np.iinfo(size.dtype).max
    return piece, size


def _enclosed(piece, size) -> np.ndarray:
    """Which pieces do not touch the border of the volume."""
    enclosed = np.ones(len(size), bool)
    enclosed[0] = False
    for axis in range(3):
        for end in (0, -1):
            enclosed[np.unique(np.take(piece, end, axis))] = False
    return enclosed


def _absorb(labels, faults) -> None:
    """Give each connected piece of the faults the label that most sound voxels around it have; ties: the lowest."""
    piece, _ = ndimage.label(faults, TOUCHING)
    for number, box in enumerate(ndimage.find_objects(piece), 1):
        wide = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in box)
        inside = piece[wide] == number
        around = labels[wide][ndimage.binary_dilation(inside, TOUCHING) & ~inside]
        labels[wide][inside] = np.bincount(around).argmax()
