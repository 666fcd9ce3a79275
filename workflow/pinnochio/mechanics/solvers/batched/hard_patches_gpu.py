"""The hard patches of all plans brought to equilibrium together on a GPU, in programs that share the work evenly.

The steps are those of `hard_patches`. The patches, or nodes, of all plans in work are dealt
out in tiles, each of one plan, to as many programs as the GPU holds. A patch is a row of its tile, an element a lane;
nodes sum their elements, and plans their tiles, in a fixed order. Conjugate gradients are in the form that sums once an
iteration (Chronopoulos and Gear 1989); what an iteration leaves of a plan, the next reads from the other record.
"""

import numpy as np
import torch
import triton
import triton.language as tl
from torch import Tensor

from pinnochio.mechanics.elements.tetrahedra import RELATIVE_ROUND_OFF, Elements
from pinnochio.mechanics.solvers.batched import hard_patches
from pinnochio.mechanics.solvers.batched.cuda_graphs import ReplayedCalls
from pinnochio.mechanics.solvers.batched.dissection import padded
from pinnochio.mechanics.solvers.batched.sparse_rows import fused
from pinnochio.mechanics.solvers.newton import UNTANGLING

LANES = 128  # places for elements in a tile [X]
NODES = 32  # of a tile [X]
CHUNK = 8  # iterations of conjugate gradients between looks at which plans need more; even [X]
PATIENCE = 0.25  # share of the plans that the others do not wait for [X]
RELATIVE = tl.constexpr(RELATIVE_ROUND_OFF)
# Rows of the flags: a plan is in work; it has a direction; Newton steps left; its field is not measured yet.
OPEN, PENDING, LEFT, FRESH = (tl.constexpr(number) for number in range(4))


class GpuHardPatches(hard_patches.PatchNeighbours):
    """As `hard_patches.HardPatches`, but a few plans may stay open, with their fields half-way."""

    def __init__(self, elements: Elements, free, plans: int, device):
        super().__init__(elements, free, device)

        def tensor(values, dtype):
            return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype, device=device)

        def empty(*shape, dtype=torch.float32):
            return torch.zeros(*shape, dtype=dtype, device=device)

        law, count, patches, nodes = elements.material, len(elements.cells), len(elements.patch_volumes), elements.nodes
        order = np.argsort(elements.patch, kind="stable")
        members = padded(np.split(order, np.cumsum(np.bincount(elements.patch))[:-1]))
        wide = max(triton.next_power_of_2(members.shape[1]), 16)
        members = np.pad(members, ((0, 0), (0, wide - members.shape[1])), constant_values=-1)
        incident = np.argsort(elements.cells.ravel(), kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(elements.cells.ravel(), minlength=nodes))])
        mesh = members, elements.cells.T, first, incident
        self._members, self._cells, self._first, self._incident = (tensor(item, torch.int32) for item in mesh)
        slopes = elements.gradients.reshape(count, 12).T
        self._fine = tensor(np.vstack([slopes, elements.volumes, law.mu, law.stiffening]), torch.float64)
        self._coarse = self._fine.float()
        self._bulk = tensor([elements.patch_volumes, elements.patch_lam], torch.float64)
        self._sizes = {"elements": count, "patches_of_mesh": patches, "nodes_of_mesh": nodes, "plans": plans}
        self._law, self._noise = law.extension, elements.round_off
        self._patches, self._nodes = (empty(plans, size + 1, dtype=torch.int32) for size in (patches, nodes))
        self._counts, self._flags = empty(2, plans, dtype=torch.int32), empty(4, plans, dtype=torch.int32)
        self._field, self._force = (empty(plans, nodes, 3, dtype=torch.float64) for _ in range(2))
        self._goal, self._lowest, self._extension = (empty(plans, dtype=torch.float64) for _ in range(3))
        self._corners = empty(plans, count, 12, dtype=torch.float64)
        self._kept, self._second = empty(plans, 13, count), empty(plans, patches)
        self._vectors = empty(6, plans, nodes, 3)  # motion, preconditioned residual, residual, its image, way, image
        self._inverse, self._across = empty(plans, 6, nodes), empty(plans, nodes, 3)
        self._tiles = triton.cdiv(patches, LANES // wide), triton.cdiv(nodes, NODES)
        self._energies = empty(2, hard_patches.SHARES, plans, self._tiles[0], dtype=torch.float64)
        self._sums = empty(2, plans, self._tiles[1], dtype=torch.float64)
        self._states, self._records = empty(2, plans, dtype=torch.float64), empty(2, 6, plans, dtype=torch.float64)
        self._remaining = empty(3, dtype=torch.int64)
        cores = torch.cuda.get_device_properties(device).multi_processor_count
        self._grid = (8 * cores,)
        self._shape = {"K": max(triton.next_power_of_2(plans), 32), "num_warps": 4}
        self._rows = {"W": wide, "P": LANES // wide}
        device = torch.device(device)
        self._start, self._step, self._more = (
            ReplayedCalls(call, device) for call in (self._started, self._stepped, self._improved)
        )

    @property
    def open(self) -> Tensor:
        """Plans (k,) bool whose patches are not in equilibrium yet."""
        return self._flags[OPEN.value] > 0

    def prepare(self, known: Tensor) -> None:
        moves, touched = (item.T.contiguous() for item in self.around(known))
        for number, (lists, mask) in enumerate(((self._patches, touched), (self._nodes, moves))):
            place = mask.cumsum(1, dtype=torch.int32)
            self._counts[number] = place[:, -1]
            size = mask.shape[1]
            numbers = torch.arange(size, dtype=torch.int32, device=mask.device).expand_as(mask)
            lists.scatter_(1, torch.where(mask, place - 1, size).long(), numbers)
        self._vectors[:2].masked_fill_(~moves[None, :, :, None], 0)  # the rest stays

    def settle(self, u: Tensor, across: Tensor, goal: Tensor, lowest: Tensor, running: Tensor) -> None:
        self._inputs = u, across, goal, lowest, running  # always the same ones
        self._start()
        made = CHUNK
        while True:
            running, waiting, active = self._remaining.tolist()
            if waiting <= PATIENCE * running:
                break
            if active > waiting // 8 and made < hard_patches.GRADIENTS:
                self._more()
                made += CHUNK
            else:
                self._step()
                made = CHUNK
        u.copy_(self._field.permute(1, 2, 0))

    def _started(self) -> None:
        """Begin with the plans that run and are not open, then as :meth:`_stepped`."""
        u, across, goal, lowest, running = self._inputs
        self._field.copy_(u.permute(2, 0, 1))
        self._across.copy_(across.permute(2, 0, 1))
        self._goal.copy_(goal)
        self._lowest.copy_(lowest)
        self._remaining[0] = running.sum()
        new = running & ~self.open
        _begin(self._flags, self._extension, self._counts, new, self._law)
        self._stepped()

    def _stepped(self) -> None:
        """Go the directions that were found, measure, and begin to look for the next ones."""
        patches = self._patches, self._counts, self._flags, self._members, self._cells, self._fine, self._bulk
        sizes, grid = self._sizes, self._grid
        with torch.cuda.device_of(self._field):
            _tried[grid](
                *patches, self._field, self._vectors, self._extension, self._energies,
                patch_tiles=self._tiles[0], SHARES=hard_patches.SHARES, **sizes, **self._rows, **self._shape,
            )  # fmt: skip
            _moved[(sizes["plans"],)](
                self._nodes, self._counts, self._flags, self._field, self._vectors, self._force, self._energies,
                self._states, self._extension, self._law, self._noise, patch_tiles=self._tiles[0],
                SHARES=hard_patches.SHARES, STEPS=hard_patches.STEPS, N=256, **sizes, **self._rows, num_warps=8,
            )  # fmt: skip
            _measured[grid](
                *patches, self._field, self._extension, self._energies, self._corners, self._kept, self._second,
                patch_tiles=self._tiles[0], **sizes, **self._rows, **self._shape,
            )  # fmt: skip
            _begun[grid](
                self._nodes, self._counts, self._flags, self._first, self._incident, self._coarse, self._corners,
                self._kept, self._force, self._vectors, self._inverse, self._sums, self._across,
                node_tiles=self._tiles[1], N=NODES, C=8, **sizes, **self._shape,
            )  # fmt: skip
            _judged[(sizes["plans"],)](
                self._counts, self._flags, self._energies, self._sums, self._states, self._records, self._extension,
                self._goal, self._lowest, self._law, UNTANGLING, patch_tiles=self._tiles[0], node_tiles=self._tiles[1],
                STEPS=hard_patches.STEPS, N=NODES, **sizes, **self._rows, num_warps=1,
            )  # fmt: skip
        self._improved()

    def _improved(self) -> None:
        """Some iterations of conjugate gradients."""
        corners, sizes, grid = self._corners.view(torch.float32), self._sizes, self._grid
        with torch.cuda.device_of(self._field):
            for number in range(CHUNK):
                now, then = self._records[number % 2], self._records[1 - number % 2]
                _product[grid](
                    self._patches, self._counts, self._flags, self._members, self._cells, self._coarse, self._vectors,
                    corners, self._kept, self._second, now, **sizes, **self._rows, **self._shape,
                )  # fmt: skip
                _imaged[grid](
                    self._nodes, self._counts, self._flags, self._first, self._incident, corners, self._vectors,
                    self._sums, now, node_tiles=self._tiles[1], N=NODES, C=8, **sizes, **self._shape,
                )  # fmt: skip
                _advanced[grid](
                    self._nodes, self._counts, self._flags, self._vectors, self._inverse, self._force, self._sums, now,
                    then, hard_patches.FORCING**2, node_tiles=self._tiles[1], N=NODES, **sizes, **self._shape,
                )  # fmt: skip
        pending = self._flags[PENDING.value] > 0
        self._remaining[1:] = torch.stack([self.open.sum(), (pending & (self._records[0, 0] > 0)).sum()])


@fused
def _begin(flags, extension, counts, new, law):
    values = counts[1] > 0, 0, hard_patches.STEPS, 1
    flags.copy_(torch.stack([torch.where(new, value, row) for value, row in zip(values, flags.unbind(), strict=True)]))
    extension.copy_(torch.where(new, law, extension))


@triton.jit
def _ends(counts, flags, record, plans, SIZE: tl.constexpr, K: tl.constexpr):
    """Of the plans' tiles of SIZE, the number of the first one that belongs to later plans; the others, whose flag or
    record is 0, have none."""
    plan = tl.arange(0, K)
    there = plan < plans
    tiles = (tl.load(counts + plan, mask=there, other=0) + SIZE - 1) // SIZE
    works = (tl.load(flags + plan, mask=there, other=0) > 0) & (tl.load(record + plan, mask=there, other=0) > 0)
    return tl.cumsum(tl.where(works, tiles, 0), 0)


@triton.jit
def _place(ends, tile, SIZE: tl.constexpr):
    """Plan of a tile, and where the tile begins in its list."""
    earlier = ends <= tile
    begin = tl.max(tl.where(earlier, ends, 0), 0)
    return tl.sum(earlier.to(tl.int32), 0).to(tl.int64), (tile - begin) * SIZE


@triton.jit
def _listed(numbers, begin, count, N: tl.constexpr):
    """N numbers of a plan's list from `begin` on, and which of them there are."""
    row = begin + tl.arange(0, N)
    there = row < count
    return tl.load(numbers + row, mask=there, other=0), there


@triton.jit
def _total(parts, count, LEAST: tl.constexpr):
    """Sum of some numbers in a fixed order, or the least of them."""
    lane = tl.arange(0, 64)
    total = tl.full((64,), float("inf") if LEAST else 0.0, tl.float64)
    for begin in range(0, count, 64):
        there = begin + lane < count
        if LEAST:
            total = tl.minimum(total, tl.load(parts + begin + lane, mask=there, other=float("inf")))
        else:
            total += tl.load(parts + begin + lane, mask=there, other=0.0)
    return tl.min(total, 0) if LEAST else tl.sum(total, 0)


@triton.jit
def _vector(x, node, there):
    one = tl.load(x + 3 * node, mask=there, other=0.0)
    two = tl.load(x + 3 * node + 1, mask=there, other=0.0)
    three = tl.load(x + 3 * node + 2, mask=there, other=0.0)
    return one, two, three


@triton.jit
def _put(x, node, there, one, two, three):
    tl.store(x + 3 * node, one, mask=there)
    tl.store(x + 3 * node + 1, two, mask=there)
    tl.store(x + 3 * node + 2, three, mask=there)


@triton.jit
def _gradient(x, cells, g, elements, e, here, DOUBLE: tl.constexpr):
    """Gradient of a field x (n, 3) in elements e."""
    h00 = (e * 0).to(tl.float64 if DOUBLE else tl.float32)
    h01, h02, h10, h11, h12, h20, h21, h22 = h00, h00, h00, h00, h00, h00, h00, h00
    for a in tl.static_range(4):
        node = tl.load(cells + a * elements + e, mask=here, other=0)
        x0, x1, x2 = _vector(x, node, here)
        g0 = tl.load(g + 3 * a * elements + e, mask=here, other=0.0)
        g1 = tl.load(g + (3 * a + 1) * elements + e, mask=here, other=0.0)
        g2 = tl.load(g + (3 * a + 2) * elements + e, mask=here, other=0.0)
        h00, h01, h02 = h00 + x0 * g0, h01 + x0 * g1, h02 + x0 * g2
        h10, h11, h12 = h10 + x1 * g0, h11 + x1 * g1, h12 + x1 * g2
        h20, h21, h22 = h20 + x2 * g0, h21 + x2 * g1, h22 + x2 * g2
    return h00, h01, h02, h10, h11, h12, h20, h21, h22


@triton.jit
def _cofactor(f00, f01, f02, f10, f11, f12, f20, f21, f22):
    c00, c01, c02 = f11 * f22 - f12 * f21, f12 * f20 - f10 * f22, f10 * f21 - f11 * f20
    c10, c11, c12 = f21 * f02 - f22 * f01, f22 * f00 - f20 * f02, f20 * f01 - f21 * f00
    c20, c21, c22 = f01 * f12 - f02 * f11, f02 * f10 - f00 * f12, f00 * f11 - f01 * f10
    return c00, c01, c02, c10, c11, c12, c20, c21, c22


@triton.jit
def _log(j, extension):
    inside = tl.maximum(j, extension)
    d = (j - inside) / inside
    return tl.log(inside) + d - 0.5 * d * d, (1 - d) / inside, -1 / (inside * inside)


@triton.jit
def _deformation(h00, h01, h02, h10, h11, h12, h20, h21, h22):
    """I1 - 3, cofactors and J of the deformation gradient to a displacement gradient."""
    excess = h00 * h00 + h01 * h01 + h02 * h02 + h10 * h10 + h11 * h11 + h12 * h12
    excess += h20 * h20 + h21 * h21 + h22 * h22 + 2 * (h00 + h11 + h22)
    f00, f11, f22 = h00 + 1, h11 + 1, h22 + 1
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactor(f00, h01, h02, h10, f11, h12, h20, h21, f22)
    return excess, c00, c01, c02, c10, c11, c12, c20, c21, c22, f00 * c00 + h01 * c01 + h02 * c02


@triton.jit
def _constants(fine, bulk, elements, patches, e, here, patch, inside):
    """Volumes, mu and stiffening of elements, volumes and lambda of patches."""
    volume = tl.load(fine + 12 * elements + e, mask=here, other=0.0)
    m = tl.load(fine + 13 * elements + e, mask=here, other=0.0)
    s = tl.load(fine + 14 * elements + e, mask=here, other=0.0)
    whole = tl.load(bulk + patch, mask=inside, other=1.0)
    return volume, m, s, whole, tl.load(bulk + patches + patch, mask=inside, other=0.0)


@triton.jit
def _energy(excess, j, volume, m, s, whole, lam, here, inside, extension):
    """Energy and least J of a tile, and derivatives of the patches' energy by their ratio, of ln J of the elements."""
    ratio = tl.where(inside, tl.sum(volume * j, axis=1) / whole, 1.0)
    log, d, dd = _log(ratio, extension)
    bulks = tl.sum(0.5 * whole * lam * log * log, 0)
    first, curve = lam * log * d, lam * (d * d + log * dd) / whole
    log, d, dd = _log(tl.where(here, j, 1.0), extension)
    energies = volume * (0.5 * m * excess + 0.5 * s * excess * excess - m * log)
    least = tl.min(tl.min(tl.where(here, j, float("inf")), 1), 0)
    return tl.sum(tl.sum(energies, 1), 0) + bulks, least, first, curve, d, dd


@triton.jit
def _tried(
    all_patches, counts, flags, members, cells, fine, bulk, fields, vectors, extensions, energies,
    elements, patches_of_mesh, nodes_of_mesh, plans, patch_tiles,
    W: tl.constexpr, P: tl.constexpr, K: tl.constexpr, SHARES: tl.constexpr,
):  # fmt: skip
    """Energies and least J where shares of the plans' motions lead to."""
    ends = _ends(counts, flags + PENDING * plans, flags + PENDING * plans, plans, P, K)
    for tile in range(tl.program_id(0), tl.max(ends, 0), tl.num_programs(0)):
        plan, begin = _place(ends, tile, P)
        patch, inside = _listed(all_patches + (patches_of_mesh + 1) * plan, begin, tl.load(counts + plan), P)
        e = tl.load(members + patch[:, None] * W + tl.arange(0, W)[None, :], mask=inside[:, None], other=-1)
        here = e >= 0
        at = 3 * nodes_of_mesh * plan
        h00, h01, h02, h10, h11, h12, h20, h21, h22 = _gradient(fields + at, cells, fine, elements, e, here, True)
        m00, m01, m02, m10, m11, m12, m20, m21, m22 = _gradient(vectors + at, cells, fine, elements, e, here, True)
        volume, m, s, whole, lam = _constants(fine, bulk, elements, patches_of_mesh, e, here, patch, inside)
        extension = tl.load(extensions + plan)
        share = extension * 0 + 1
        for number in range(SHARES):
            excess, _, _, _, _, _, _, _, _, _, j = _deformation(
                h00 + share * m00, h01 + share * m01, h02 + share * m02, h10 + share * m10, h11 + share * m11,
                h12 + share * m12, h20 + share * m20, h21 + share * m21, h22 + share * m22,
            )  # fmt: skip
            energy, least, _, _, _, _ = _energy(excess, j, volume, m, s, whole, lam, here, inside, extension)
            out = energies + (number * plans + plan) * patch_tiles + begin // P
            tl.store(out, energy)
            tl.store(out + SHARES * plans * patch_tiles, least)
            share *= 0.3


@triton.jit
def _moved(
    all_nodes, counts, flags, fields, vectors, forces, energies, states, extensions, law, noise,
    elements, patches_of_mesh, nodes_of_mesh, plans, patch_tiles,
    W: tl.constexpr, P: tl.constexpr, SHARES: tl.constexpr, STEPS: tl.constexpr, N: tl.constexpr,
):  # fmt: skip
    """Go the largest share of a plan's motion that lowers its energy."""
    plan = tl.program_id(0).to(tl.int64)
    if tl.load(flags + PENDING * plans + plan) > 0:
        count, tiles = tl.load(counts + plans + plan), tl.cdiv(tl.load(counts + plan), P)
        nodes, at = all_nodes + (nodes_of_mesh + 1) * plan, 3 * nodes_of_mesh * plan
        falls = tl.zeros((N,), tl.float64)
        for begin in range(0, count, N):
            node, there = _listed(nodes, begin, count, N)
            x, y, z = _vector(forces + at, node, there)
            mx, my, mz = _vector(vectors + at, node, there)
            falls += x * mx + y * my + z * mz
        slope = tl.sum(falls, 0)
        energy, least = tl.load(states + plan), tl.load(states + plans + plan)
        barrier = tl.where(least > 0, 0.0, -float("inf"))
        slack = noise + RELATIVE * tl.abs(energy)
        share, taken = energy * 0 + 1, energy * 0
        for number in range(SHARES):
            parts = energies + (number * plans + plan) * patch_tiles
            there_energy = _total(parts, tiles, False)
            there_least = _total(parts + SHARES * plans * patch_tiles, tiles, True)
            good = (there_energy <= energy + 1e-4 * share * slope + slack) & (there_least > barrier)
            taken = tl.where(good & (taken == 0), share, taken)
            share *= 0.3
        for begin in range(0, count, N):
            node, there = _listed(nodes, begin, count, N)
            x, y, z = _vector(fields + at, node, there)
            mx, my, mz = _vector(vectors + at, node, there)
            _put(fields + at, node, there, x + taken * mx, y + taken * my, z + taken * mz)
        stuck, left = taken == 0, tl.load(flags + LEFT * plans + plan)
        loose = tl.load(extensions + plan) != law
        tl.store(flags + PENDING * plans + plan, 0)
        tl.store(flags + LEFT * plans + plan, tl.where(stuck, STEPS, left - 1))
        if stuck:
            if loose:
                tl.store(extensions + plan, law)
            else:
                tl.store(flags + OPEN * plans + plan, 0)


@triton.jit
def _measured(
    all_patches, counts, flags, members, cells, fine, bulk, fields, extensions, energies, all_corners, all_kept,
    seconds, elements, patches_of_mesh, nodes_of_mesh, plans, patch_tiles,
    W: tl.constexpr, P: tl.constexpr, K: tl.constexpr,
):  # fmt: skip
    """Energies and least J, forces at the elements' corners, and what the tangent needs."""
    ends = _ends(counts, flags + OPEN * plans, flags + OPEN * plans, plans, P, K)
    for tile in range(tl.program_id(0), tl.max(ends, 0), tl.num_programs(0)):
        plan, begin = _place(ends, tile, P)
        patch, inside = _listed(all_patches + (patches_of_mesh + 1) * plan, begin, tl.load(counts + plan), P)
        e = tl.load(members + patch[:, None] * W + tl.arange(0, W)[None, :], mask=inside[:, None], other=-1)
        here = e >= 0
        h00, h01, h02, h10, h11, h12, h20, h21, h22 = _gradient(
            fields + 3 * nodes_of_mesh * plan, cells, fine, elements, e, here, True
        )
        excess, c00, c01, c02, c10, c11, c12, c20, c21, c22, j = _deformation(
            h00, h01, h02, h10, h11, h12, h20, h21, h22
        )
        volume, m, s, whole, lam = _constants(fine, bulk, elements, patches_of_mesh, e, here, patch, inside)
        energy, least, first, curve, d, dd = _energy(
            excess, j, volume, m, s, whole, lam, here, inside, tl.load(extensions + plan)
        )
        out = energies + plan * patch_tiles + begin // P
        tl.store(out, energy)
        tl.store(out + plans * patch_tiles, least)
        f00, f11, f22 = h00 + 1, h11 + 1, h22 + 1
        shear = volume * (m + 2 * s * excess)
        bulk_stress = volume * (first[:, None] - m * d)
        curvature = -volume * m * dd
        _store_corners(
            all_corners + 12 * elements * plan, fine, elements, e, here,
            shear * f00 + bulk_stress * c00, shear * h01 + bulk_stress * c01, shear * h02 + bulk_stress * c02,
            shear * h10 + bulk_stress * c10, shear * f11 + bulk_stress * c11, shear * h12 + bulk_stress * c12,
            shear * h20 + bulk_stress * c20, shear * h21 + bulk_stress * c21, shear * f22 + bulk_stress * c22,
        )  # fmt: skip
        kept = all_kept + 13 * elements * plan + e
        tl.store(kept, f00.to(tl.float32), mask=here)
        tl.store(kept + elements, h01.to(tl.float32), mask=here)
        tl.store(kept + 2 * elements, h02.to(tl.float32), mask=here)
        tl.store(kept + 3 * elements, h10.to(tl.float32), mask=here)
        tl.store(kept + 4 * elements, f11.to(tl.float32), mask=here)
        tl.store(kept + 5 * elements, h12.to(tl.float32), mask=here)
        tl.store(kept + 6 * elements, h20.to(tl.float32), mask=here)
        tl.store(kept + 7 * elements, h21.to(tl.float32), mask=here)
        tl.store(kept + 8 * elements, f22.to(tl.float32), mask=here)
        tl.store(kept + 9 * elements, shear.to(tl.float32), mask=here)
        tl.store(kept + 10 * elements, bulk_stress.to(tl.float32), mask=here)
        tl.store(kept + 11 * elements, curvature.to(tl.float32), mask=here)
        stiff = tl.maximum(curvature + volume * volume * curve[:, None], 0.0)
        tl.store(kept + 12 * elements, stiff.to(tl.float32), mask=here)
        tl.store(seconds + patches_of_mesh * plan + patch, curve.to(tl.float32), mask=inside)


@triton.jit
def _store_corners(out, g, elements, e, here, p00, p01, p02, p10, p11, p12, p20, p21, p22):
    for a in tl.static_range(4):
        g0 = tl.load(g + 3 * a * elements + e, mask=here, other=0.0)
        g1 = tl.load(g + (3 * a + 1) * elements + e, mask=here, other=0.0)
        g2 = tl.load(g + (3 * a + 2) * elements + e, mask=here, other=0.0)
        tl.store(out + 12 * e + 3 * a, p00 * g0 + p01 * g1 + p02 * g2, mask=here)
        tl.store(out + 12 * e + 3 * a + 1, p10 * g0 + p11 * g1 + p12 * g2, mask=here)
        tl.store(out + 12 * e + 3 * a + 2, p20 * g0 + p21 * g1 + p22 * g2, mask=here)


@triton.jit
def _gathered(corners, first, incident, node, there, DOUBLE: tl.constexpr, N: tl.constexpr, C: tl.constexpr):
    """Sum of the corners' vectors at nodes, C of them at a time."""
    start = tl.load(first + node, mask=there, other=0)
    count = tl.where(there, tl.load(first + node + 1, mask=there, other=0) - start, 0)
    x = tl.zeros((N, C), tl.float64 if DOUBLE else tl.float32)
    y, z = x, x
    for k in range(0, tl.max(count, 0), C):
        place = k + tl.arange(0, C)
        here = place[None, :] < count[:, None]
        at = tl.load(incident + start[:, None] + place[None, :], mask=here, other=0)
        cx, cy, cz = _vector(corners, at, here)
        x, y, z = x + cx, y + cy, z + cz
    return tl.sum(x, axis=1), tl.sum(y, axis=1), tl.sum(z, axis=1)


@triton.jit
def _tangent(kept, elements, e, here):
    f00 = tl.load(kept + e, mask=here, other=0.0)
    f01 = tl.load(kept + elements + e, mask=here, other=0.0)
    f02 = tl.load(kept + 2 * elements + e, mask=here, other=0.0)
    f10 = tl.load(kept + 3 * elements + e, mask=here, other=0.0)
    f11 = tl.load(kept + 4 * elements + e, mask=here, other=0.0)
    f12 = tl.load(kept + 5 * elements + e, mask=here, other=0.0)
    f20 = tl.load(kept + 6 * elements + e, mask=here, other=0.0)
    f21 = tl.load(kept + 7 * elements + e, mask=here, other=0.0)
    f22 = tl.load(kept + 8 * elements + e, mask=here, other=0.0)
    return f00, f01, f02, f10, f11, f12, f20, f21, f22


@triton.jit
def _begun(
    all_nodes, counts, flags, first, incident, coarse, all_corners, all_kept, forces, vectors, inverses, sums, across,
    elements, patches_of_mesh, nodes_of_mesh, plans, node_tiles, N: tl.constexpr, C: tl.constexpr, K: tl.constexpr,
):  # fmt: skip
    """Forces at the nodes, inverses of the tangent's blocks there, about, and where conjugate gradients begin; of
    sliding nodes what lies in their tangent planes."""
    ends = _ends(counts + plans, flags + OPEN * plans, flags + OPEN * plans, plans, N, K)
    for tile in range(tl.program_id(0), tl.max(ends, 0), tl.num_programs(0)):
        plan, begin = _place(ends, tile, N)
        node, there = _listed(all_nodes + (nodes_of_mesh + 1) * plan, begin, tl.load(counts + plans + plan), N)
        at, step = 3 * nodes_of_mesh * plan, 3 * nodes_of_mesh * plans
        corners, kept = all_corners + 12 * elements * plan, all_kept + 13 * elements * plan
        x, y, z = _gathered(corners, first, incident, node, there, True, N, C)
        n0, n1, n2 = _vector(across + at, node, there)
        pressed = x * n0 + y * n1 + z * n2
        x, y, z = x - pressed * n0, y - pressed * n1, z - pressed * n2
        _put(forces + at, node, there, x, y, z)
        tl.store(sums + plan * node_tiles + begin // N, tl.sum(x * x + y * y + z * z, 0))
        start = tl.load(first + node, mask=there, other=0)
        length = tl.where(there, tl.load(first + node + 1, mask=there, other=0) - start, 0)
        a00 = tl.zeros((N, C), tl.float32)
        a01, a02, a11, a12, a22 = a00, a00, a00, a00, a00
        for k in range(0, tl.max(length, 0), C):
            lane = k + tl.arange(0, C)
            here = lane[None, :] < length[:, None]
            corner = tl.load(incident + start[:, None] + lane[None, :], mask=here, other=0)
            e = corner // 4
            place = 3 * (corner % 4) * elements + e
            g0 = tl.load(coarse + place, mask=here, other=0.0)
            g1 = tl.load(coarse + place + elements, mask=here, other=0.0)
            g2 = tl.load(coarse + place + 2 * elements, mask=here, other=0.0)
            f00, f01, f02, f10, f11, f12, f20, f21, f22 = _tangent(kept, elements, e, here)
            c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactor(f00, f01, f02, f10, f11, f12, f20, f21, f22)
            volume = tl.load(coarse + 12 * elements + e, mask=here, other=0.0)
            stretch = 4 * volume * tl.load(coarse + 14 * elements + e, mask=here, other=0.0)
            shear = tl.load(kept + 9 * elements + e, mask=here, other=0.0) * (g0 * g0 + g1 * g1 + g2 * g2)
            stiff = tl.load(kept + 12 * elements + e, mask=here, other=0.0)
            p0, p1, p2 = f00 * g0 + f01 * g1 + f02 * g2, f10 * g0 + f11 * g1 + f12 * g2, f20 * g0 + f21 * g1 + f22 * g2
            q0, q1, q2 = c00 * g0 + c01 * g1 + c02 * g2, c10 * g0 + c11 * g1 + c12 * g2, c20 * g0 + c21 * g1 + c22 * g2
            a00 += shear + stretch * p0 * p0 + stiff * q0 * q0
            a01 += stretch * p0 * p1 + stiff * q0 * q1
            a02 += stretch * p0 * p2 + stiff * q0 * q2
            a11 += shear + stretch * p1 * p1 + stiff * q1 * q1
            a12 += stretch * p1 * p2 + stiff * q1 * q2
            a22 += shear + stretch * p2 * p2 + stiff * q2 * q2
        a00, a01, a02 = tl.sum(a00, axis=1), tl.sum(a01, axis=1), tl.sum(a02, axis=1)
        a11, a12, a22 = tl.sum(a11, axis=1), tl.sum(a12, axis=1), tl.sum(a22, axis=1)
        c0, c1, c2 = a11 * a22 - a12 * a12, a12 * a02 - a01 * a22, a01 * a12 - a11 * a02
        det = a00 * c0 + a01 * c1 + a02 * c2
        over = tl.where(det > 0, 1 / tl.where(det > 0, det, 1.0), 0.0)
        i00, i01, i02 = c0 * over, c1 * over, c2 * over
        i11, i12, i22 = (a00 * a22 - a02 * a02) * over, (a01 * a02 - a00 * a12) * over, (a00 * a11 - a01 * a01) * over
        v0, v1, v2 = i00 * n0 + i01 * n1 + i02 * n2, i01 * n0 + i11 * n1 + i12 * n2, i02 * n0 + i12 * n1 + i22 * n2
        q = n0 * v0 + n1 * v1 + n2 * v2
        i00, i01, i02 = (
            i00 + (q * n0 - 2 * v0) * n0,
            i01 + (q * n0 - v0) * n1 - n0 * v1,
            i02 + (q * n0 - v0) * n2 - n0 * v2,
        )
        i11, i12, i22 = i11 + (q * n1 - 2 * v1) * n1, i12 + (q * n1 - v1) * n2 - n1 * v2, i22 + (q * n2 - 2 * v2) * n2
        inverse = inverses + 6 * nodes_of_mesh * plan + node
        tl.store(inverse, i00, mask=there)
        tl.store(inverse + nodes_of_mesh, i01, mask=there)
        tl.store(inverse + 2 * nodes_of_mesh, i02, mask=there)
        tl.store(inverse + 3 * nodes_of_mesh, i11, mask=there)
        tl.store(inverse + 4 * nodes_of_mesh, i12, mask=there)
        tl.store(inverse + 5 * nodes_of_mesh, i22, mask=there)
        x, y, z = -x.to(tl.float32), -y.to(tl.float32), -z.to(tl.float32)
        zx, zy, zz = i00 * x + i01 * y + i02 * z, i01 * x + i11 * y + i12 * z, i02 * x + i12 * y + i22 * z
        _restarted(vectors + at, step, node, there, x, y, z, zx, zy, zz)


@triton.jit
def _restarted(vectors, step, node, there, x, y, z, zx, zy, zz):
    """No motion yet, with the residual x, y, z and its preconditioned one."""
    _put(vectors + step, node, there, zx, zy, zz)
    _put(vectors + 2 * step, node, there, x, y, z)
    _put(vectors, node, there, x * 0, x * 0, x * 0)
    _put(vectors + 4 * step, node, there, x * 0, x * 0, x * 0)
    _put(vectors + 5 * step, node, there, x * 0, x * 0, x * 0)


@triton.jit
def _judged(
    counts, flags, energies, sums, states, records, extensions, goals, lowest, law, untangling,
    elements, patches_of_mesh, nodes_of_mesh, plans, patch_tiles, node_tiles,
    W: tl.constexpr, P: tl.constexpr, STEPS: tl.constexpr, N: tl.constexpr,
):  # fmt: skip
    """Which plans want a direction. What is inside out is untangled first, with ln J extended far."""
    plan = tl.program_id(0).to(tl.int64)
    if tl.load(flags + OPEN * plans + plan) > 0:
        patches, nodes = tl.cdiv(tl.load(counts + plan), P), tl.cdiv(tl.load(counts + plans + plan), N)
        energy = _total(energies + plan * patch_tiles, patches, False)
        least = _total(energies + (plans + plan) * patch_tiles, patches, True)
        size = tl.sqrt(_total(sums + plan * node_tiles, nodes, False))
        loose, left = tl.load(extensions + plan) != law, tl.load(flags + LEFT * plans + plan)
        fresh, bound = tl.load(flags + FRESH * plans + plan) > 0, tl.load(lowest + plan)
        # What is still inside out after it was to be untangled is as little worth as what is wild.
        wild = tl.where(fresh, least < bound, (loose == 0) & (left == STEPS) & (least <= 0) & (bound > -float("inf")))
        tangled = fresh & (least <= 0) & (wild == 0)
        wants = (size > tl.load(goals + plan)) & (left > 0) & (tangled == 0) & (wild == 0)
        tl.store(flags + FRESH * plans + plan, 0)
        tl.store(flags + PENDING * plans + plan, wants.to(tl.int32))
        tl.store(states + plan, energy)
        tl.store(states + plans + plan, least)
        if wants:
            tl.store(records + plan, 1.0)  # active
            tl.store(records + plans + plan, 1.0)  # first iteration
            tl.store(records + 2 * plans + plan, 0.0)  # damped
        else:
            tl.store(flags + LEFT * plans + plan, STEPS)
            tl.store(flags + OPEN * plans + plan, (tangled | loose).to(tl.int32))
            tl.store(extensions + plan, tl.where(tangled, untangling, law))


@triton.jit
def _product(
    all_patches, counts, flags, members, cells, coarse, vectors, all_corners, all_kept, seconds, record,
    elements, patches_of_mesh, nodes_of_mesh, plans, W: tl.constexpr, P: tl.constexpr, K: tl.constexpr,
):  # fmt: skip
    """The tangent times the preconditioned residual, at the corners."""
    ends = _ends(counts, flags + PENDING * plans, record, plans, P, K)
    for tile in range(tl.program_id(0), tl.max(ends, 0), tl.num_programs(0)):
        plan, begin = _place(ends, tile, P)
        patch, inside = _listed(all_patches + (patches_of_mesh + 1) * plan, begin, tl.load(counts + plan), P)
        e = tl.load(members + patch[:, None] * W + tl.arange(0, W)[None, :], mask=inside[:, None], other=-1)
        here = e >= 0
        damped = tl.load(record + 2 * plans + plan) > 0
        way = vectors + 3 * nodes_of_mesh * (plans + plan)
        kept = all_kept + 13 * elements * plan
        d00, d01, d02, d10, d11, d12, d20, d21, d22 = _gradient(way, cells, coarse, elements, e, here, False)
        f00, f01, f02, f10, f11, f12, f20, f21, f22 = _tangent(kept, elements, e, here)
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactor(f00, f01, f02, f10, f11, f12, f20, f21, f22)
        volume = tl.load(coarse + 12 * elements + e, mask=here, other=0.0)
        s = tl.load(coarse + 14 * elements + e, mask=here, other=0.0)
        shear = tl.load(kept + 9 * elements + e, mask=here, other=0.0)
        bulk = tl.load(kept + 10 * elements + e, mask=here, other=0.0)
        curvature = tl.load(kept + 11 * elements + e, mask=here, other=0.0)
        second = tl.load(seconds + patches_of_mesh * plan + patch, mask=inside, other=0.0)
        if damped:
            size = f00 * f00 + f01 * f01 + f02 * f02 + f10 * f10 + f11 * f11 + f12 * f12
            size += f20 * f20 + f21 * f21 + f22 * f22
            most = 0.5 * shear / tl.sqrt(tl.maximum(size, 1e-12))
            bulk = tl.minimum(tl.maximum(bulk, -most), most)
            second = tl.maximum(second, 0.0)
        along = c00 * d00 + c01 * d01 + c02 * d02 + c10 * d10 + c11 * d11 + c12 * d12
        along += c20 * d20 + c21 * d21 + c22 * d22
        pressure = second * tl.sum(volume * along, axis=1)
        stretch = f00 * d00 + f01 * d01 + f02 * d02 + f10 * d10 + f11 * d11 + f12 * d12
        stretch = 4 * s * volume * (stretch + f20 * d20 + f21 * d21 + f22 * d22)
        along = curvature * along + volume * pressure[:, None]
        _store_corners(
            all_corners + 24 * elements * plan, coarse, elements, e, here,
            shear * d00 + stretch * f00 + along * c00 + bulk * (d11 * f22 + f11 * d22 - d12 * f21 - f12 * d21),
            shear * d01 + stretch * f01 + along * c01 + bulk * (d12 * f20 + f12 * d20 - d10 * f22 - f10 * d22),
            shear * d02 + stretch * f02 + along * c02 + bulk * (d10 * f21 + f10 * d21 - d11 * f20 - f11 * d20),
            shear * d10 + stretch * f10 + along * c10 + bulk * (d21 * f02 + f21 * d02 - d22 * f01 - f22 * d01),
            shear * d11 + stretch * f11 + along * c11 + bulk * (d22 * f00 + f22 * d00 - d20 * f02 - f20 * d02),
            shear * d12 + stretch * f12 + along * c12 + bulk * (d20 * f01 + f20 * d01 - d21 * f00 - f21 * d00),
            shear * d20 + stretch * f20 + along * c20 + bulk * (d01 * f12 + f01 * d12 - d02 * f11 - f02 * d11),
            shear * d21 + stretch * f21 + along * c21 + bulk * (d02 * f10 + f02 * d10 - d00 * f12 - f00 * d12),
            shear * d22 + stretch * f22 + along * c22 + bulk * (d00 * f11 + f00 * d11 - d01 * f10 - f01 * d10),
        )  # fmt: skip


@triton.jit
def _imaged(
    all_nodes, counts, flags, first, incident, all_corners, vectors, sums, record,
    elements, patches_of_mesh, nodes_of_mesh, plans, node_tiles, N: tl.constexpr, C: tl.constexpr, K: tl.constexpr,
):  # fmt: skip
    """That product at the nodes, and the products of the preconditioned residual with it and with the residual."""
    ends = _ends(counts + plans, flags + PENDING * plans, record, plans, N, K)
    for tile in range(tl.program_id(0), tl.max(ends, 0), tl.num_programs(0)):
        plan, begin = _place(ends, tile, N)
        node, there = _listed(all_nodes + (nodes_of_mesh + 1) * plan, begin, tl.load(counts + plans + plan), N)
        x, y, z = _gathered(all_corners + 24 * elements * plan, first, incident, node, there, False, N, C)
        at, step = 3 * nodes_of_mesh * plan, 3 * nodes_of_mesh * plans
        _put(vectors + at + 3 * step, node, there, x, y, z)
        zx, zy, zz = _vector(vectors + at + step, node, there)
        rx, ry, rz = _vector(vectors + at + 2 * step, node, there)
        out = sums + plan * node_tiles + begin // N
        tl.store(out, tl.sum((rx * zx + ry * zy + rz * zz).to(tl.float64), 0))
        tl.store(out + plans * node_tiles, tl.sum((x * zx + y * zy + z * zz).to(tl.float64), 0))


@triton.jit
def _advanced(
    all_nodes, counts, flags, vectors, inverses, forces, sums, now, then, forcing,
    elements, patches_of_mesh, nodes_of_mesh, plans, node_tiles, N: tl.constexpr, K: tl.constexpr,
):  # fmt: skip
    """An iteration of conjugate gradients; where the energy bends downwards, it begins anew with the tangent damped."""
    ends = _ends(counts + plans, flags + PENDING * plans, flags + PENDING * plans, plans, N, K)
    for tile in range(tl.program_id(0), tl.max(ends, 0), tl.num_programs(0)):
        plan, begin = _place(ends, tile, N)
        active = tl.load(now + plan) > 0
        if active:
            count = tl.load(counts + plans + plan)
            node, there = _listed(all_nodes + (nodes_of_mesh + 1) * plan, begin, count, N)
            gain = _total(sums + plan * node_tiles, tl.cdiv(count, N), False)
            curvature = _total(sums + (plans + plan) * node_tiles, tl.cdiv(count, N), False)
            fresh, damped = tl.load(now + plans + plan) > 0, tl.load(now + 2 * plans + plan) > 0
            before, length = tl.load(now + 3 * plans + plan), tl.load(now + 4 * plans + plan)
            begun = tl.where(fresh, gain, tl.load(now + 5 * plans + plan))
            turn = tl.where(fresh, 0.0, gain / before)
            curvature = tl.where(fresh, curvature, curvature - turn * gain / length)
            enough = ((fresh == 0) & (gain <= forcing * begun)) | (gain <= 0)
            bad = (enough == 0) & ((curvature > 0) == 0)
            again = bad & (damped == 0)
            goes = (enough == 0) & (bad == 0)
            length = tl.where(goes, gain / tl.where(goes, curvature, 1.0), 1.0)
            at, step = 3 * nodes_of_mesh * plan, 3 * nodes_of_mesh * plans
            inverse = inverses + 6 * nodes_of_mesh * plan + node
            a = tl.load(inverse, mask=there, other=0.0)
            b = tl.load(inverse + nodes_of_mesh, mask=there, other=0.0)
            c = tl.load(inverse + 2 * nodes_of_mesh, mask=there, other=0.0)
            d = tl.load(inverse + 3 * nodes_of_mesh, mask=there, other=0.0)
            e = tl.load(inverse + 4 * nodes_of_mesh, mask=there, other=0.0)
            f = tl.load(inverse + 5 * nodes_of_mesh, mask=there, other=0.0)
            if goes:
                along, share = turn.to(tl.float32), length.to(tl.float32)
                zx, zy, zz = _vector(vectors + at + step, node, there)
                px, py, pz = _vector(vectors + at + 4 * step, node, there)
                px, py, pz = zx + along * px, zy + along * py, zz + along * pz
                _put(vectors + at + 4 * step, node, there, px, py, pz)
                mx, my, mz = _vector(vectors + at, node, there)
                _put(vectors + at, node, there, mx + share * px, my + share * py, mz + share * pz)
                wx, wy, wz = _vector(vectors + at + 3 * step, node, there)
                sx, sy, sz = _vector(vectors + at + 5 * step, node, there)
                sx, sy, sz = wx + along * sx, wy + along * sy, wz + along * sz
                _put(vectors + at + 5 * step, node, there, sx, sy, sz)
                x, y, z = _vector(vectors + at + 2 * step, node, there)
                x, y, z = x - share * sx, y - share * sy, z - share * sz
                _put(vectors + at + 2 * step, node, there, x, y, z)
                zx, zy, zz = a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z
                _put(vectors + at + step, node, there, zx, zy, zz)
            if again:
                x, y, z = _vector(forces + at, node, there)
                x, y, z = -x.to(tl.float32), -y.to(tl.float32), -z.to(tl.float32)
                zx, zy, zz = a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z
                _restarted(vectors + at, step, node, there, x, y, z, zx, zy, zz)
            if begin == 0:
                tl.store(then + plan, (goes | again).to(tl.float64))
                tl.store(then + plans + plan, again.to(tl.float64))
                tl.store(then + 2 * plans + plan, (damped | again).to(tl.float64))
                tl.store(then + 3 * plans + plan, gain)
                tl.store(then + 4 * plans + plan, length)
                tl.store(then + 5 * plans + plan, begun)
        else:
            if begin == 0:
                tl.store(then + plan, 0.0)
