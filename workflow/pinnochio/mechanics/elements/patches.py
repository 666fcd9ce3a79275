"""Patches of neighbouring elements over which volume is averaged."""

import numpy as np

from pinnochio.compiled import compiled
from pinnochio.geometry.mesh_topology import adjacency

SIZE = 8  # elements in a patch; the table of elements in docs/lab/mechanics.md shows why
TIE = 1e-4  # distances nearer to each other count as equal: above the rounding of coordinates in single precision


def make_patches(points, cells, tissue, size: int = SIZE) -> np.ndarray:
    """Patch (m,) int32 of each element: connected through faces, of one value of `tissue` (m,), about `size` each.

    points (n, 3), cells (m, 4). Patches grow one after the other from the first element that is left, always by the
    neighbour that shares most nodes with the patch, the nearest to its centre among equals; what is left over with
    fewer than half of `size` elements joins the smallest patch beside it. Turning, moving or scaling the mesh changes
    nothing.
    """
    cells = np.asarray(cells, np.int32)
    centres = np.asarray(points, float)[cells].mean(axis=1)
    neighbours = _neighbours(cells, np.asarray(tissue))
    patch, member = np.full(len(cells), -1, np.int32), np.full(len(points), -1, np.int32)
    _grow(cells, centres, neighbours, patch, member, size)
    sizes = np.bincount(patch)
    target = np.arange(len(sizes))
    _join(patch, neighbours, sizes, target, size)
    return np.unique(target[patch], return_inverse=True)[1].astype(np.int32)


def _neighbours(cells, tissue) -> np.ndarray:
    """Element (m, 4) across each face that has the same tissue, -1 where there is none."""
    one, two = adjacency(cells)
    alike = tissue[one // 4] == tissue[two // 4]
    across = np.full(4 * len(cells), -1, np.int32)
    across[one[alike]], across[two[alike]] = two[alike] // 4, one[alike] // 4
    return across.reshape(-1, 4)


@compiled
def _grow(cells, centres, neighbours, patch, member, size):
    """Number of the patch of each element into `patch`; `member`: the last patch that each node belonged to."""
    count = 0
    border = [0] * (4 * size + 4)
    for seed in range(len(cells)):
        if patch[seed] >= 0:
            continue
        x, y, z, have, length = 0.0, 0.0, 0.0, 0, 0
        chosen = seed
        while chosen >= 0:
            patch[chosen] = count
            for a in range(4):
                member[cells[chosen][a]] = count
                if neighbours[chosen][a] >= 0:
                    border[length] = neighbours[chosen][a]
                    length += 1
            x = (x * have + centres[chosen][0]) / (have + 1)
            y = (y * have + centres[chosen][1]) / (have + 1)
            z = (z * have + centres[chosen][2]) / (have + 1)
            have += 1
            chosen = -1
            if have == size:
                break
            most, nearest = -1, np.inf
            for k in range(length):
                e = border[k]
                if patch[e] >= 0:
                    continue
                shared = 0
                for a in range(4):
                    shared += member[cells[e][a]] == count
                dx, dy, dz = centres[e][0] - x, centres[e][1] - y, centres[e][2] - z
                away = dx * dx + dy * dy + dz * dz
                # Lattices are full of ties; they go by index, not by rounding.
                nearer = away < nearest * (1 - TIE) or (away <= nearest * (1 + TIE) and e < chosen)
                if shared > most or (shared == most and nearer):
                    chosen, most, nearest = e, shared, away
        count += 1


@compiled
def _join(patch, neighbours, sizes, target, size):
    """The patch that each one goes into, in `target`: itself unless it is too small."""
    for e in range(len(patch)):
        number = patch[e]
        if 2 * sizes[number] >= size:
            continue
        for a in range(4):
            other = patch[neighbours[e][a]] if neighbours[e][a] >= 0 else number
            if other == number or 2 * sizes[other] < size:
                continue
            best = target[number]
            smaller = sizes[other] < sizes[best] or (sizes[other] == sizes[best] and other < best)
            if best == number or smaller:
                target[number] = other
