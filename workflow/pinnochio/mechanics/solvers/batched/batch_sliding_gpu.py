"""Sliding nodes put back on their bones on a GPU: a program per node and plan, a lane per point of the bone.

The field is that of :mod:`pinnochio.mechanics.boundary.sliding`. Its nearest points are those within a distance that is
bisected until so many lie within it.
"""

from collections.abc import Sequence

import numpy as np
import torch
import triton
import triton.language as tl
from torch import Tensor

from pinnochio.mechanics.boundary.sliding import Bones, SlidingNodes
from pinnochio.mechanics.solvers.batched import batch_sliding

MOST = 4096  # points of a bone that the lanes of a program can hold


class GpuSliding(batch_sliding.BatchAxes):
    """As `batch_sliding.BatchSliding`; TooManyPointsError if a bone has more than MOST."""

    def __init__(self, bones: Bones, plans: int, device):
        super().__init__(bones, plans, device)

        def tensor(values, dtype):
            return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype, device=device)

        most = int(np.diff(bones.first).max(initial=1))
        if most > MOST:
            raise batch_sliding.TooManyPointsError(f"a bone has {most} points beside sliding tissue, more than {MOST}")
        whole = bones.nodes, bones.owner, bones.first, bones.count
        real = bones.rest, bones.level, bones.frames, bones.points, bones.normals, bones.width
        self._bones = *(tensor(item, torch.int32) for item in whole), *(tensor(item, torch.float64) for item in real)
        self._motion = torch.zeros(plans, len(bones.width), 12, dtype=torch.float64, device=device)
        self._shape = {"LANES": triton.next_power_of_2(most), "num_warps": 4 if most <= 1024 else 8}

    def begin(self, slots: Sequence[int], held: Sequence[SlidingNodes]) -> None:
        motion = [np.concatenate([item.turns.reshape(-1, 9), item.shifts], axis=1) for item in held]
        at = torch.as_tensor(np.asarray(slots), device=self._motion.device)
        self._motion[at] = torch.as_tensor(np.array(motion), device=self._motion.device)

    def project(self, u: Tensor, wanted: Tensor) -> None:
        nodes, _, _, plans = self.axes.shape
        if not nodes:
            return
        with torch.cuda.device_of(u):
            _project[(nodes, plans)](
                u, self.axes, wanted, self._motion, *self._bones, plans, self._motion.shape[1], **self._shape
            )


@triton.jit
def _three(x, step):
    return tl.load(x), tl.load(x + step), tl.load(x + 2 * step)


@triton.jit
def _put(x, step, there, one, two, three):
    tl.store(x, one, mask=there)
    tl.store(x + step, two, mask=there)
    tl.store(x + 2 * step, three, mask=there)


@triton.jit
def _cross(a0, a1, a2, b0, b1, b2):
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@triton.jit
def _field(x0, x1, x2, points, normals, size, count, width, LANES: tl.constexpr):
    """Signed distance of a place from a bone, and its gradient."""
    lane = tl.arange(0, LANES)
    there = lane < size
    a0 = x0 - tl.load(points + 3 * lane, mask=there, other=0.0)
    a1 = x1 - tl.load(points + 3 * lane + 1, mask=there, other=0.0)
    a2 = x2 - tl.load(points + 3 * lane + 2, mask=there, other=0.0)
    square = tl.where(there, a0 * a0 + a1 * a1 + a2 * a2, float("inf"))
    least = tl.min(square, 0)
    low, high = least, tl.max(tl.where(there, square, least), 0)
    halvings = 0
    while (tl.sum((square <= high).to(tl.int32), 0) > count) & (halvings < 64):
        middle = 0.5 * (low + high)
        enough = tl.sum((square <= middle).to(tl.int32), 0) >= count
        low, high = tl.where(enough, low, middle), tl.where(enough, middle, high)
        halvings += 1
    weight = tl.where(square <= high, tl.exp((least - square) / width), 0.0)
    weight = weight / tl.sum(weight, 0)
    m0 = tl.load(normals + 3 * lane, mask=there, other=0.0)
    m1 = tl.load(normals + 3 * lane + 1, mask=there, other=0.0)
    m2 = tl.load(normals + 3 * lane + 2, mask=there, other=0.0)
    plane = a0 * m0 + a1 * m1 + a2 * m2
    n0, n1, n2 = tl.sum(weight * m0, 0), tl.sum(weight * m1, 0), tl.sum(weight * m2, 0)
    o0, o1, o2 = tl.sum(weight * a0, 0), tl.sum(weight * a1, 0), tl.sum(weight * a2, 0)
    first = tl.sum(weight * plane, 0)
    length = tl.maximum(tl.sqrt(n0 * n0 + n1 * n1 + n2 * n2), 1e-3)
    n0, n1, n2 = n0 / length, n1 / length, n2 / length
    second = n0 * o0 + n1 * o1 + n2 * o2
    t0, t1, t2 = (o0 - second * n0) / length, (o1 - second * n1) / length, (o2 - second * n2) / length
    # d weight/dx = -2/width weight (offset - mean offset): derivatives of averages are covariances.
    change = plane + t0 * m0 + t1 * m1 + t2 * m2 + a0 * n0 + a1 * n1 + a2 * n2
    change = -2 / width * weight * change
    g0 = n0 * (1 + length) + tl.sum(change * (a0 - o0), 0)
    g1 = n1 * (1 + length) + tl.sum(change * (a1 - o1), 0)
    g2 = n2 * (1 + length) + tl.sum(change * (a2 - o2), 0)
    return (first + second) / 2, g0 / 2, g1 / 2, g2 / 2


@triton.jit
def _rotated(x0, x1, x2, t00, t01, t02, t10, t11, t12, t20, t21, t22):
    return t00 * x0 + t01 * x1 + t02 * x2, t10 * x0 + t11 * x1 + t12 * x2, t20 * x0 + t21 * x1 + t22 * x2


@triton.jit
def _turned(v0, v1, v2, r0, r1, r2, cosine):
    """A vector turned by the axis r, of the length of the angle's sine."""
    c0, c1, c2 = _cross(r0, r1, r2, v0, v1, v2)
    d0, d1, d2 = _cross(r0, r1, r2, c0, c1, c2)
    return v0 + c0 + d0 / (1 + cosine), v1 + c1 + d1 / (1 + cosine), v2 + c2 + d2 / (1 + cosine)


@triton.jit
def _project(
    u, axes, wanted, motion, nodes, owner, first, counts, rests, levels, frames, points, normals, widths, plans, bones,
    LANES: tl.constexpr,
):  # fmt: skip
    s, plan = tl.program_id(0).to(tl.int64), tl.program_id(1)
    bone = tl.load(owner + s)
    begin = tl.load(first + bone)
    size, count = tl.load(first + bone + 1) - begin, tl.load(counts + bone)
    width, level = tl.load(widths + bone), tl.load(levels + s)
    points, normals = points + 3 * begin, normals + 3 * begin
    place = motion + (plan * bones + bone) * 12
    t00, t01, t02 = _three(place, 1)
    t10, t11, t12 = _three(place + 3, 1)
    t20, t21, t22 = _three(place + 6, 1)
    shift0, shift1, shift2 = _three(place + 9, 1)
    rest0, rest1, rest2 = _three(rests + 3 * s, 1)
    place = u + 3 * tl.load(nodes + s).to(tl.int64) * plans + plan
    u0, u1, u2 = _three(place, plans)
    y0, y1, y2 = rest0 + u0 - shift0, rest1 + u1 - shift1, rest2 + u2 - shift2
    x0, x1, x2 = t00 * y0 + t10 * y1 + t20 * y2, t01 * y0 + t11 * y1 + t21 * y2, t02 * y0 + t12 * y1 + t22 * y2
    value, g0, g1, g2 = _field(x0, x1, x2, points, normals, size, count, width, LANES)
    gap, made, here = level - value, 0, tl.load(wanted + plan) != 0
    while here & (tl.abs(gap) > 1e-9) & (made < 200):
        slope = g0 * g0 + g1 * g1 + g2 * g2
        # A step is never longer than 2 mm: across a sharp edge the gradient says little about what lies beyond.
        way = gap / tl.maximum(slope, 0.01)
        way = way * tl.minimum(2 / tl.maximum(tl.abs(way) * tl.sqrt(slope), 1e-30), 1.0)
        x0, x1, x2 = x0 + way * g0, x1 + way * g1, x2 + way * g2
        value, g0, g1, g2 = _field(x0, x1, x2, points, normals, size, count, width, LANES)
        gap, made = level - value, made + 1
    moved = here & (made > 0)
    x0, x1, x2 = _rotated(x0, x1, x2, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    _put(place, plans, moved, shift0 - rest0 + x0, shift1 - rest1 + x1, shift2 - rest2 + x2)
    length = tl.maximum(tl.sqrt(g0 * g0 + g1 * g1 + g2 * g2), 1e-12)
    g0, g1, g2 = g0 / length, g1 / length, g2 / length
    n0, n1, n2 = _rotated(g0, g1, g2, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    a0, a1, a2 = _three(frames + 9 * s, 1)
    b0, b1, b2 = _three(frames + 9 * s + 3, 1)
    c0, c1, c2 = _three(frames + 9 * s + 6, 1)
    a0, a1, a2 = _rotated(a0, a1, a2, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    b0, b1, b2 = _rotated(b0, b1, b2, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    c0, c1, c2 = _rotated(c0, c1, c2, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    cosine = a0 * n0 + a1 * n1 + a2 * n2
    if cosine > -0.9:
        r0, r1, r2 = _cross(a0, a1, a2, n0, n1, n2)
        b0, b1, b2 = _turned(b0, b1, b2, r0, r1, r2, cosine)
        c0, c1, c2 = _turned(c0, c1, c2, r0, r1, r2, cosine)
    else:
        # It points back: any tangents serve, the first across the axis of the world that is farthest from the normal.
        w0 = ((tl.abs(n0) <= tl.abs(n1)) & (tl.abs(n0) <= tl.abs(n2))).to(tl.float64)
        w1 = (1 - w0) * (tl.abs(n1) <= tl.abs(n2)).to(tl.float64)
        w2 = 1 - w0 - w1
        b0, b1, b2 = _cross(n0, n1, n2, w0, w1, w2)
        across = tl.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        b0, b1, b2 = b0 / across, b1 / across, b2 / across
        c0, c1, c2 = _cross(n0, n1, n2, b0, b1, b2)
    row = axes + 9 * s * plans + plan
    _put(row, plans, here, n0, n1, n2)
    _put(row + 3 * plans, plans, here, b0, b1, b2)
    _put(row + 6 * plans, plans, here, c0, c1, c2)
