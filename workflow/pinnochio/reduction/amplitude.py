"""How far a plan can move the tissue, estimated on voxels before anything is meshed."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg

from pinnochio.meshing.fields import is_tissue
from pinnochio.model.labels import AIR, CRANIUM, segment_code, segment_name
from pinnochio.plans.plan import Plan

EDGE = 2.0  # mm of a block, or one voxel where that is larger
BONE_SHARE = 0.25  # of a block's voxels that makes it bone: thin plates keep what lies on their two sides apart
TISSUE_SHARE = 0.5  # that makes it tissue
RESIDUAL = 1e-6  # relative, of the linear solve


@dataclass(frozen=True)
class Amplitude:
    """value (nx, ny, nz) mm of blocks of `factor` (3,) voxels each, over the volume of `shape` voxels."""

    value: np.ndarray
    factor: tuple[int, int, int]
    shape: tuple[int, int, int]

    def voxels(self) -> np.ndarray:
        """Amplitude (mm) of every voxel."""
        return _fine(self.value, self.factor)[tuple(slice(n) for n in self.shape)]

    def at(self, points, spacing, origin) -> np.ndarray:
        """Amplitude (mm) of the block that holds each of the points (..., 3) mm."""
        voxel = np.clip(np.rint((points - origin) / spacing).astype(int), 0, np.array(self.shape) - 1)
        return self.value[tuple(np.moveaxis(voxel // self.factor, -1, 0))]


def amplitude(labels, spacing, origin, segments, plan: Plan, moving, pairs, band_mm, release_mm) -> Amplitude:
    """Amplitude of a plan: harmonic in tissue, on moving bone the length of its displacement, on all other bone and on
    the border of the volume zero.

    labels (nx, ny, nz) internal codes, spacing and origin (3,) mm; moving: names of the segments that are followed;
    pairs of indices of the bones that oppose each other; band_mm, release_mm: as in the interfaces. Bone that stays
    does not hold the tissue (natural condition) where the interfaces do not: where it slides, nearer than `band_mm` to
    a segment that opposes it, and where it is released, nearer than `release_mm` to moving bone at an osteotomy.
    Harmonic functions have their extremes on the boundary, and the length of a harmonic vector field is at most the
    harmonic function of its length on the boundary; elasticity keeps to that nearly.

    Slits thinner than a block, as between the lips, do not separate: both sides are taken to move.
    """
    labels, spacing, origin = np.asarray(labels), np.asarray(spacing, float), np.asarray(origin, float)
    factor = np.maximum(np.rint(EDGE / spacing).astype(int), 1)
    whole = np.pad(labels, [(0, -n % f) for n, f in zip(labels.shape, factor, strict=True)])
    block = factor * spacing
    place = np.stack(np.indices(whole.shape // factor), -1) * block + origin + (block - spacing) / 2

    codes = {"cranium": CRANIUM} | {name: segment_code(i) for i, name in enumerate(segments)}
    share = {name: _means(whole == code, factor) for name, code in codes.items()}
    away = {name: _distance(share[name] > 0, block) for name in segments}
    opposed = {frozenset(segment_name(i, segments) for i in pair) for pair in pairs}
    loose = np.zeros(whole.shape, bool)
    for name, code in codes.items():
        if name in moving:
            continue
        near = np.zeros(place.shape[:3], bool)
        for other in segments:
            if frozenset((name, other)) in opposed:
                near |= away[other] < band_mm
            elif other in moving:
                near |= away[other] < release_mm
        loose |= _fine(near, factor) & (whole == code)
        share[name] = _means((whole == code) & ~_fine(near, factor), factor)

    bony = sum(share.values()) >= BONE_SHARE
    value = np.zeros(bony.shape)
    most = np.maximum.reduce(list(share.values()))
    for name in moving:
        own = bony & (share[name] == most) & (share[name] > 0)
        value[own] = np.linalg.norm(plan.motion(name).displacement(place[own]), axis=1)
    tissue = _means(is_tissue(whole), factor) >= TISSUE_SHARE
    border = np.ones(tissue.shape, bool)
    border[1:-1, 1:-1, 1:-1] = False
    free = tissue & ~bony & ~border
    known = bony | (tissue & border)
    solid = _means((whole != AIR) & ~loose, factor) >= TISSUE_SHARE
    joined = _solve(value, free & solid, known & solid, block)
    # Lattice nodes beside tissue belong to it, and so do blocks with too little of it to conduct.
    unknown = ~(joined | known)
    nearest = ndimage.distance_transform_edt(unknown, sampling=block, return_distances=False, return_indices=True)
    return Amplitude(value[tuple(nearest)], tuple(factor.tolist()), labels.shape)


def _solve(value, free, known, block) -> np.ndarray:
    """Fill `value` on free blocks (in place): Laplace's equation, the values of `known` blocks.

    block (3,) mm. Returns the free blocks (bool) that hang on known ones.
    """
    number = np.full(free.shape, -1)
    number[free] = np.arange(free.sum())
    rows, columns, links = [], [], []
    diagonal, right, hold = (np.zeros(free.sum()) for _ in range(3))
    for axis in range(3):
        weight = block.prod() / block[axis] ** 2
        one, two = (tuple(slice(a, b) if k == axis else slice(None) for k in range(3)) for a, b in ((0, -1), (1, None)))
        for here, there in ((one, two), (two, one)):
            link = free[here] & (free | known)[there]
            own, other = number[here][link], number[there][link]
            inner = other >= 0
            diagonal += weight * np.bincount(own, minlength=len(diagonal))
            hold += np.bincount(own[~inner], minlength=len(hold))
            right += weight * np.bincount(own[~inner], value[there][link][~inner], len(right))
            rows, columns = [*rows, own[inner]], [*columns, other[inner]]
            links.append(np.full(inner.sum(), weight))
    count = len(diagonal)
    graph = sparse.csr_array((np.concatenate(links), (np.concatenate(rows), np.concatenate(columns))), (count, count))
    _, piece = connected_components(graph, directed=False)
    hangs = np.bincount(piece, hold)[piece] > 0
    matrix = (sparse.diags_array(diagonal).tocsr() - graph)[hangs][:, hangs]
    solution = np.zeros(count)
    solution[hangs], failed = cg(
        matrix, right[hangs], rtol=RESIDUAL, maxiter=5000, M=sparse.diags_array(1 / diagonal[hangs])
    )
    if failed:
        raise RuntimeError("the amplitude did not converge")
    value[free] = solution
    joined = np.zeros(free.shape, bool)
    joined[free] = hangs
    return joined


def _means(mask, factor) -> np.ndarray:
    """Share of True voxels of every block."""
    a, b, c = np.array(mask.shape) // factor
    return mask.reshape(a, factor[0], b, factor[1], c, factor[2]).mean(axis=(1, 3, 5), dtype=np.float32)


def _fine(blocks, factor) -> np.ndarray:
    """A value per block as one per voxel."""
    for axis, times in enumerate(factor):
        blocks = blocks.repeat(times, axis)
    return blocks


def _distance(blocks, block) -> np.ndarray:
    """Distance (mm) of every block from the True ones, infinite if there is none."""
    return ndimage.distance_transform_edt(~blocks, sampling=block) if blocks.any() else np.full(blocks.shape, np.inf)
