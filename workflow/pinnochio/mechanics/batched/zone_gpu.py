"""The hard patches of every plan brought to equilibrium on a GPU: one Triton program per plan, from start to end.

The steps are those of :mod:`pinnochio.mechanics.batched.zone`. A program goes through the patches of its plan, a patch
per row and an element per lane, then through their nodes, each of which sums its elements in a fixed order.
"""

import numpy as np
import torch
import triton
import triton.language as tl
from torch import Tensor

from pinnochio.mechanics.batched import zone
from pinnochio.mechanics.batched.dissection import padded
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.solver import UNTANGLING

_WARPS = 8  # of a program [X]
_LARGEST = 16  # elements of a patch: the few larger ones stay as they are


class Zone(zone.Patches):
    """As :class:`pinnochio.mechanics.batched.zone.Zone`."""

    def __init__(self, elements: Elements, free, plans: int, device):
        free, sizes = np.array(free), np.bincount(elements.patch)
        free[elements.cells[sizes[elements.patch] > _LARGEST]] = False
        super().__init__(elements, free, device)

        def tensor(values, dtype):
            return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype, device=device)

        law, count, patches = elements.material, len(elements.cells), len(elements.patch_volumes)
        order = np.argsort(elements.patch, kind="stable")
        members = padded(np.split(order, np.cumsum(np.bincount(elements.patch))[:-1]))
        members = np.pad(members, ((0, 0), (0, _LARGEST)), constant_values=-1)[:, :_LARGEST]
        incident = np.argsort(elements.cells.ravel(), kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(elements.cells.ravel(), minlength=elements.nodes))])
        self._integers = [tensor(item, torch.int32) for item in (members, elements.cells.T, first, incident)]
        slopes = elements.gradients.reshape(count, 12).T
        reals = slopes, elements.volumes, law.mu, law.stiffening, elements.patch_volumes, elements.patch_lam
        self._reals = [tensor(item, torch.float64) for item in reals]
        self._slopes = self._reals[0].float()
        self._extension, self._noise = law.extension, 1e-14 * elements.modulus * elements.volumes.sum()

        def empty(*shape, dtype=torch.float32):
            return torch.zeros(plans, *shape, dtype=dtype, device=device)

        self._patches, self._nodes = empty(patches + 1, dtype=torch.int32), empty(elements.nodes + 1, dtype=torch.int32)
        self._counts = empty(2, dtype=torch.int32)
        self._field = empty(elements.nodes, 3, dtype=torch.float64)
        self._ahead = empty(elements.nodes, 3, dtype=torch.float64)
        self._force = empty(elements.nodes, 3, dtype=torch.float64)
        self._corner = empty(count, 12, dtype=torch.float64)
        self._corners = empty(count, 12)
        self._kept, self._second = empty(13, count), empty(patches)
        self._vectors = empty(4, elements.nodes, 3)  # motion, residual, way, image
        self._inverse = empty(6, elements.nodes)

    def prepare(self, known: Tensor) -> None:
        moves, touched = self.around(known)
        for number, (lists, mask) in enumerate(((self._patches, touched), (self._nodes, moves))):
            mask = mask.T.contiguous()
            place = mask.cumsum(1)
            self._counts[:, number] = place[:, -1]
            size = mask.shape[1]
            numbers = torch.arange(size, dtype=torch.int32, device=mask.device).expand_as(mask)
            lists.scatter_(1, torch.where(mask, place - 1, size), numbers)
        self._vectors.zero_()

    def settle(self, u: Tensor, goal: Tensor) -> None:
        self._field.copy_(u.permute(2, 0, 1))
        plans, nodes, _ = self._field.shape
        with torch.cuda.device_of(u):
            _settle[(plans,)](
                self._field, self._ahead, goal, self._patches, self._nodes, self._counts, *self._integers, *self._reals,
                self._slopes, self._force, self._corner, self._corners, self._kept, self._second, self._vectors,
                self._inverse, nodes, self._kept.shape[2], self._second.shape[1], self._extension, UNTANGLING,
                self._noise, zone.FORCING**2,
                W=_LARGEST, P=max(32 * _WARPS // _LARGEST, 1), N=16 * _WARPS, K=8,
                STEPS=zone.STEPS, GRADIENTS=zone.GRADIENTS, num_warps=_WARPS,
            )  # fmt: skip
        u.copy_(self._field.permute(1, 2, 0))


@triton.jit
def _listed(numbers, begin, count, N: tl.constexpr):
    """N numbers of a plan's list from `begin` on, and which of them there are."""
    row = begin + tl.arange(0, N)
    there = row < count
    return tl.load(numbers + row, mask=there, other=0), there


@triton.jit
def _patches(patches, members, begin, count, W: tl.constexpr, P: tl.constexpr):
    """P patches of a plan from `begin` on, which of them there are, and their elements (P, W), -1 for none."""
    patch, inside = _listed(patches, begin, count, P)
    e = tl.load(members + patch[:, None] * W + tl.arange(0, W)[None, :], mask=inside[:, None], other=-1)
    return patch, inside, e


@triton.jit
def _gradient(x, cells, g, elements, e, here):
    """Gradient of a field x (n, 3) in elements e."""
    node = tl.load(cells + e, mask=here, other=0)
    x0 = tl.load(x + 3 * node, mask=here, other=0.0)
    x1 = tl.load(x + 3 * node + 1, mask=here, other=0.0)
    x2 = tl.load(x + 3 * node + 2, mask=here, other=0.0)
    g0 = tl.load(g + e, mask=here, other=0.0)
    g1 = tl.load(g + elements + e, mask=here, other=0.0)
    g2 = tl.load(g + 2 * elements + e, mask=here, other=0.0)
    h00, h01, h02 = x0 * g0, x0 * g1, x0 * g2
    h10, h11, h12 = x1 * g0, x1 * g1, x1 * g2
    h20, h21, h22 = x2 * g0, x2 * g1, x2 * g2
    for a in tl.static_range(1, 4):
        node = tl.load(cells + a * elements + e, mask=here, other=0)
        x0 = tl.load(x + 3 * node, mask=here, other=0.0)
        x1 = tl.load(x + 3 * node + 1, mask=here, other=0.0)
        x2 = tl.load(x + 3 * node + 2, mask=here, other=0.0)
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
def _store_corners(out, g, elements, e, here, p00, p01, p02, p10, p11, p12, p20, p21, p22):
    for a in tl.static_range(4):
        g0 = tl.load(g + 3 * a * elements + e, mask=here, other=0.0)
        g1 = tl.load(g + (3 * a + 1) * elements + e, mask=here, other=0.0)
        g2 = tl.load(g + (3 * a + 2) * elements + e, mask=here, other=0.0)
        tl.store(out + 12 * e + 3 * a, p00 * g0 + p01 * g1 + p02 * g2, mask=here)
        tl.store(out + 12 * e + 3 * a + 1, p10 * g0 + p11 * g1 + p12 * g2, mask=here)
        tl.store(out + 12 * e + 3 * a + 2, p20 * g0 + p21 * g1 + p22 * g2, mask=here)


@triton.jit
def _measure(
    u, patches, count, members, cells, g, volumes, mu, stiffening, patch_volumes, patch_lam, corner, kept, second,
    elements, extension, FORCES: tl.constexpr, W: tl.constexpr, P: tl.constexpr,
):  # fmt: skip
    """Energy and least J of the plan's patches; with FORCES also forces at the corners and what the tangent needs."""
    energies, least = tl.zeros((P, W), tl.float64), tl.full((P, W), float("inf"), tl.float64)
    bulks = tl.zeros((P,), tl.float64)
    for start in range(0, count, P):
        patch, inside, e = _patches(patches, members, start, count, W, P)
        here = e >= 0
        h00, h01, h02, h10, h11, h12, h20, h21, h22 = _gradient(u, cells, g, elements, e, here)
        excess = h00 * h00 + h01 * h01 + h02 * h02 + h10 * h10 + h11 * h11 + h12 * h12
        excess += h20 * h20 + h21 * h21 + h22 * h22 + 2 * (h00 + h11 + h22)
        f00, f11, f22 = h00 + 1, h11 + 1, h22 + 1
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactor(f00, h01, h02, h10, f11, h12, h20, h21, f22)
        j = f00 * c00 + h01 * c01 + h02 * c02
        volume = tl.load(volumes + e, mask=here, other=0.0)
        m = tl.load(mu + e, mask=here, other=0.0)
        s = tl.load(stiffening + e, mask=here, other=0.0)
        whole = tl.load(patch_volumes + patch, mask=inside, other=1.0)
        lam = tl.load(patch_lam + patch, mask=inside, other=0.0)
        ratio = tl.sum(volume * j, axis=1) / whole
        log, d, dd = _log(tl.where(inside, ratio, 1.0), extension)
        bulks += 0.5 * whole * lam * log * log
        first = lam * log * d
        curve = lam * (d * d + log * dd) / whole
        log, d, dd = _log(tl.where(here, j, 1.0), extension)
        energies += volume * (0.5 * m * excess + 0.5 * s * excess * excess - m * log)
        least = tl.minimum(least, tl.where(here, j, float("inf")))
        if FORCES:
            shear = volume * (m + 2 * s * excess)
            bulk = volume * (first[:, None] - m * d)
            bend = -volume * m * dd
            _store_corners(
                corner, g, elements, e, here,
                shear * f00 + bulk * c00, shear * h01 + bulk * c01, shear * h02 + bulk * c02,
                shear * h10 + bulk * c10, shear * f11 + bulk * c11, shear * h12 + bulk * c12,
                shear * h20 + bulk * c20, shear * h21 + bulk * c21, shear * f22 + bulk * c22,
            )  # fmt: skip
            tl.store(kept + e, f00.to(tl.float32), mask=here)
            tl.store(kept + elements + e, h01.to(tl.float32), mask=here)
            tl.store(kept + 2 * elements + e, h02.to(tl.float32), mask=here)
            tl.store(kept + 3 * elements + e, h10.to(tl.float32), mask=here)
            tl.store(kept + 4 * elements + e, f11.to(tl.float32), mask=here)
            tl.store(kept + 5 * elements + e, h12.to(tl.float32), mask=here)
            tl.store(kept + 6 * elements + e, h20.to(tl.float32), mask=here)
            tl.store(kept + 7 * elements + e, h21.to(tl.float32), mask=here)
            tl.store(kept + 8 * elements + e, f22.to(tl.float32), mask=here)
            tl.store(kept + 9 * elements + e, shear.to(tl.float32), mask=here)
            tl.store(kept + 10 * elements + e, bulk.to(tl.float32), mask=here)
            tl.store(kept + 11 * elements + e, bend.to(tl.float32), mask=here)
            stiff = tl.maximum(bend + volume * volume * curve[:, None], 0.0)
            tl.store(kept + 12 * elements + e, stiff.to(tl.float32), mask=here)
            tl.store(second + patch, curve.to(tl.float32), mask=inside)
    tl.debug_barrier()
    return tl.sum(tl.sum(energies, 1), 0) + tl.sum(bulks, 0), tl.min(tl.min(least, 1), 0)


@triton.jit
def _load_kept(kept, elements, e, here):
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
def _product(
    way, patches, count, members, cells, g, volumes, stiffening, corners, kept, second, elements,
    W: tl.constexpr, P: tl.constexpr,
):  # fmt: skip
    """The tangent times a step `way` (n, 3), at the corners."""
    for start in range(0, count, P):
        patch, inside, e = _patches(patches, members, start, count, W, P)
        here = e >= 0
        d00, d01, d02, d10, d11, d12, d20, d21, d22 = _gradient(way, cells, g, elements, e, here)
        f00, f01, f02, f10, f11, f12, f20, f21, f22 = _load_kept(kept, elements, e, here)
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactor(f00, f01, f02, f10, f11, f12, f20, f21, f22)
        volume = tl.load(volumes + e, mask=here, other=0.0).to(tl.float32)
        s = tl.load(stiffening + e, mask=here, other=0.0).to(tl.float32)
        shear = tl.load(kept + 9 * elements + e, mask=here, other=0.0)
        bulk = tl.load(kept + 10 * elements + e, mask=here, other=0.0)
        bend = tl.load(kept + 11 * elements + e, mask=here, other=0.0)
        along = c00 * d00 + c01 * d01 + c02 * d02 + c10 * d10 + c11 * d11 + c12 * d12
        along += c20 * d20 + c21 * d21 + c22 * d22
        pressure = tl.load(second + patch, mask=inside, other=0.0) * tl.sum(volume * along, axis=1)
        stretch = f00 * d00 + f01 * d01 + f02 * d02 + f10 * d10 + f11 * d11 + f12 * d12
        stretch = 4 * s * volume * (stretch + f20 * d20 + f21 * d21 + f22 * d22)
        along = bend * along + volume * pressure[:, None]
        _store_corners(
            corners, g, elements, e, here,
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
    tl.debug_barrier()


@triton.jit
def _gathered(corners, first, incident, node, there, K: tl.constexpr):
    """Sum of the corners' vectors at nodes, K of them at a time."""
    start = tl.load(first + node, mask=there, other=0)
    count = tl.where(there, tl.load(first + node + 1, mask=there, other=0) - start, 0)
    x = tl.zeros((node.shape[0], K), corners.dtype.element_ty)
    y, z = x, x
    for k in range(0, tl.max(count, 0), K):
        place = k + tl.arange(0, K)
        here = place[None, :] < count[:, None]
        at = tl.load(incident + start[:, None] + place[None, :], mask=here, other=0)
        x += tl.load(corners + 3 * at, mask=here, other=0.0)
        y += tl.load(corners + 3 * at + 1, mask=here, other=0.0)
        z += tl.load(corners + 3 * at + 2, mask=here, other=0.0)
    return tl.sum(x, axis=1), tl.sum(y, axis=1), tl.sum(z, axis=1)


@triton.jit
def _load_vector(x, node, there):
    one = tl.load(x + 3 * node, mask=there, other=0.0)
    two = tl.load(x + 3 * node + 1, mask=there, other=0.0)
    three = tl.load(x + 3 * node + 2, mask=there, other=0.0)
    return one, two, three


@triton.jit
def _store_vector(x, node, there, one, two, three):
    tl.store(x + 3 * node, one, mask=there)
    tl.store(x + 3 * node + 1, two, mask=there)
    tl.store(x + 3 * node + 2, three, mask=there)


@triton.jit
def _move(to, u, motion, share, nodes, count, N: tl.constexpr):
    """Put a plan's nodes to where a share of their motion takes them from u."""
    for begin in range(0, count, N):
        node, there = _listed(nodes, begin, count, N)
        x, y, z = _load_vector(u, node, there)
        mx, my, mz = _load_vector(motion, node, there)
        _store_vector(to, node, there, x + share * mx, y + share * my, z + share * mz)


@triton.jit
def _invert_blocks(
    nodes,
    count,
    first,
    incident,
    g,
    volumes,
    stiffening,
    kept,
    elements,
    inverse,
    size,
    N: tl.constexpr,
    K: tl.constexpr,
):
    """Inverses of the tangent's blocks at the nodes, about, into inverse (6, n)."""
    for begin in range(0, count, N):
        node, there = _listed(nodes, begin, count, N)
        start = tl.load(first + node, mask=there, other=0)
        length = tl.where(there, tl.load(first + node + 1, mask=there, other=0) - start, 0)
        a00 = tl.zeros((N, K), tl.float32)
        a01, a02, a11, a12, a22 = a00, a00, a00, a00, a00
        for k in range(0, tl.max(length, 0), K):
            lane = k + tl.arange(0, K)
            here = lane[None, :] < length[:, None]
            at = tl.load(incident + start[:, None] + lane[None, :], mask=here, other=0)
            e = at // 4
            place = 3 * (at % 4) * elements + e
            g0 = tl.load(g + place, mask=here, other=0.0)
            g1 = tl.load(g + place + elements, mask=here, other=0.0)
            g2 = tl.load(g + place + 2 * elements, mask=here, other=0.0)
            f00, f01, f02, f10, f11, f12, f20, f21, f22 = _load_kept(kept, elements, e, here)
            c00, c01, c02, c10, c11, c12, c20, c21, c22 = _cofactor(f00, f01, f02, f10, f11, f12, f20, f21, f22)
            volume = tl.load(volumes + e, mask=here, other=0.0).to(tl.float32)
            stretch = 4 * volume * tl.load(stiffening + e, mask=here, other=0.0).to(tl.float32)
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
        tl.store(inverse + node, c0 * over, mask=there)
        tl.store(inverse + size + node, c1 * over, mask=there)
        tl.store(inverse + 2 * size + node, c2 * over, mask=there)
        tl.store(inverse + 3 * size + node, (a00 * a22 - a02 * a02) * over, mask=there)
        tl.store(inverse + 4 * size + node, (a01 * a02 - a00 * a12) * over, mask=there)
        tl.store(inverse + 5 * size + node, (a00 * a11 - a01 * a01) * over, mask=there)
    tl.debug_barrier()


@triton.jit
def _applied(inverse, size, node, there, x, y, z):
    a = tl.load(inverse + node, mask=there, other=0.0)
    b = tl.load(inverse + size + node, mask=there, other=0.0)
    c = tl.load(inverse + 2 * size + node, mask=there, other=0.0)
    d = tl.load(inverse + 3 * size + node, mask=there, other=0.0)
    e = tl.load(inverse + 4 * size + node, mask=there, other=0.0)
    f = tl.load(inverse + 5 * size + node, mask=there, other=0.0)
    return a * x + b * y + c * z, b * x + d * y + e * z, c * x + e * y + f * z


@triton.jit
def _settle(
    fields, aheads, goals, all_patches, all_nodes, counts, members, cells, first, incident,
    gradients, volumes, mu, stiffening, patch_volumes, patch_lam, slopes, forces, all_corner, all_corners, all_kept,
    all_second, vectors, inverses, size, elements, patch_count, law, untangling, noise, forcing,
    W: tl.constexpr, P: tl.constexpr, N: tl.constexpr, K: tl.constexpr, STEPS: tl.constexpr, GRADIENTS: tl.constexpr,
):  # fmt: skip
    plan = tl.program_id(0).to(tl.int64)
    u, ahead, force = fields + 3 * size * plan, aheads + 3 * size * plan, forces + 3 * size * plan
    patches, nodes = all_patches + (patch_count + 1) * plan, all_nodes + (size + 1) * plan
    corner, corners, kept = (
        all_corner + 12 * elements * plan,
        all_corners + 12 * elements * plan,
        all_kept + 13 * elements * plan,
    )
    second, inverse = all_second + patch_count * plan, inverses + 6 * size * plan
    motion = vectors + 12 * size * plan
    residual, way, image = motion + 3 * size, motion + 6 * size, motion + 9 * size
    count, moving = tl.load(counts + 2 * plan), tl.load(counts + 2 * plan + 1)
    goal = tl.load(goals + plan)
    extension = law
    left = tl.where(moving > 0, STEPS, 0)
    begins = 1
    while left > 0:
        energy, least = _measure(
            u, patches, count, members, cells, gradients, volumes, mu, stiffening, patch_volumes, patch_lam, corner,
            kept, second, elements, extension, True, W, P,
        )  # fmt: skip
        tangled = (begins == 1) & (least <= 0)
        begins = 0
        norms = tl.zeros((N,), tl.float64)
        for begin in range(0, moving, N):
            node, there = _listed(nodes, begin, moving, N)
            x, y, z = _gathered(corner, first, incident, node, there, K)
            norms += x * x + y * y + z * z
            _store_vector(force, node, there, x, y, z)
        share = energy * 0
        if (tl.sqrt(tl.sum(norms, 0)) > goal) & (tangled == 0):
            _invert_blocks(
                nodes, moving, first, incident, slopes, volumes, stiffening, kept, elements, inverse, size, N, K
            )
            sizes = tl.zeros((N,), tl.float32)
            for begin in range(0, moving, N):
                node, there = _listed(nodes, begin, moving, N)
                x, y, z = _load_vector(force, node, there)
                x, y, z = -x.to(tl.float32), -y.to(tl.float32), -z.to(tl.float32)
                zx, zy, zz = _applied(inverse, size, node, there, x, y, z)
                sizes += x * zx + y * zy + z * zz
                _store_vector(residual, node, there, x, y, z)
                _store_vector(way, node, there, zx, zy, zz)
                _store_vector(motion, node, there, x * 0, x * 0, x * 0)
            tl.debug_barrier()
            gain = tl.sum(sizes, 0)
            enough = forcing * gain
            more = tl.where(gain > 0, GRADIENTS, 0)
            begun = 0
            while more > 0:
                _product(
                    way, patches, count, members, cells, slopes, volumes, stiffening, corners, kept, second, elements,
                    W, P,
                )  # fmt: skip
                bends = tl.zeros((N,), tl.float32)
                for begin in range(0, moving, N):
                    node, there = _listed(nodes, begin, moving, N)
                    x, y, z = _gathered(corners, first, incident, node, there, K)
                    wx, wy, wz = _load_vector(way, node, there)
                    bends += wx * x + wy * y + wz * z
                    _store_vector(image, node, there, x, y, z)
                tl.debug_barrier()
                bend = tl.sum(bends, 0)
                good = bend > 0
                step = tl.where(good, gain / tl.where(good, bend, 1.0), tl.where(begun == 0, 1.0, 0.0))
                sizes = tl.zeros((N,), tl.float32)
                for begin in range(0, moving, N):
                    node, there = _listed(nodes, begin, moving, N)
                    wx, wy, wz = _load_vector(way, node, there)
                    mx, my, mz = _load_vector(motion, node, there)
                    _store_vector(motion, node, there, mx + step * wx, my + step * wy, mz + step * wz)
                    rx, ry, rz = _load_vector(residual, node, there)
                    x, y, z = _load_vector(image, node, there)
                    rx, ry, rz = rx - step * x, ry - step * y, rz - step * z
                    _store_vector(residual, node, there, rx, ry, rz)
                    zx, zy, zz = _applied(inverse, size, node, there, rx, ry, rz)
                    sizes += rx * zx + ry * zy + rz * zz
                new = tl.sum(sizes, 0)
                for begin in range(0, moving, N):
                    node, there = _listed(nodes, begin, moving, N)
                    rx, ry, rz = _load_vector(residual, node, there)
                    wx, wy, wz = _load_vector(way, node, there)
                    zx, zy, zz = _applied(inverse, size, node, there, rx, ry, rz)
                    turn = new / gain
                    _store_vector(way, node, there, zx + turn * wx, zy + turn * wy, zz + turn * wz)
                tl.debug_barrier()
                gain = new
                begun = 1
                more = tl.where(good & (new > enough), more - 1, 0)
            falls = tl.zeros((N,), tl.float64)
            for begin in range(0, moving, N):
                node, there = _listed(nodes, begin, moving, N)
                x, y, z = _load_vector(force, node, there)
                mx, my, mz = _load_vector(motion, node, there)
                falls += x * mx + y * my + z * mz
            slope = tl.sum(falls, 0)
            barrier = tl.where(least > 0, 0.0, -float("inf"))
            slack = noise + 1e-13 * tl.abs(energy)
            for begin in range(0, count, P):
                patch, inside, e = _patches(patches, members, begin, count, W, P)
                for a in tl.static_range(4):
                    node = tl.load(cells + a * elements + e, mask=e >= 0, other=0)
                    x, y, z = _load_vector(u, node, e >= 0)
                    _store_vector(ahead, node, e >= 0, x, y, z)
            tl.debug_barrier()
            trial = 0
            while trial < 3:
                part = energy * 0 + tl.where(trial == 0, 1.0, tl.where(trial == 1, 0.4, 0.1))
                _move(ahead, u, motion, part, nodes, moving, N)
                tl.debug_barrier()
                there_energy, there_least = _measure(
                    ahead, patches, count, members, cells, gradients, volumes, mu, stiffening, patch_volumes, patch_lam,
                    corner, kept, second, elements, extension, False, W, P,
                )  # fmt: skip
                allowed = energy + 1e-4 * part * slope + slack
                good = (there_energy <= allowed) & (there_least > barrier)
                share = tl.where(good, part, share)
                trial = tl.where(good, 3, trial + 1)
            if share > 0:
                _move(u, u, motion, share, nodes, moving, N)
            tl.debug_barrier()
        stuck = (share == 0) & (tangled == 0)
        left = tl.where(stuck & (extension == law), 0, tl.where(tangled, left, left - 1))
        extension = tl.where(stuck, law, extension)
        extension = tl.where(tangled, untangling, extension)
