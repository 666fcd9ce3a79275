"""The graph-attention layer on a GPU: one Triton program per node, forward and backward, without atomic operations.

The formulas are those of :mod:`pinnochio.networks.gatv2_cpu`. The gradient of a node as a target is summed over the
edges into it, as a source over those out of it, and those of the weights over fixed groups of nodes: two runs give the
same bits. Kernels are compiled once per width, not per graph.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

from pinnochio.networks.layout import Inputs, Layout

# Of 4 to 32 edges, 1 to 4 warps and 1024 to all groups, the fastest on an H200 at 5,000 and at 20,000 nodes [X].
_CHUNK = 8  # edges that a program reads at a time
_WARPS = 1
_GROUPS = 4096  # of nodes whose gradients of the weights are summed one after another


def forward(x, inputs: Inputs, layout: Layout, slope: float) -> tuple[Tensor, ...]:
    """As :func:`pinnochio.networks.gatv2_cpu.forward`."""
    heads = len(inputs.a)
    before, out = torch.empty_like(x), torch.empty_like(x)
    score, norm = x.new_empty(len(inputs.d), heads), x.new_empty(len(x), heads)
    with torch.cuda.device_of(x):
        _forward[(len(x),)](
            x, *inputs, layout.source, layout.arriving, score, norm, before, out, slope, **_sizes(inputs.a)
        )
    return out, score, norm, before


def backward(g, inputs: Inputs, kept, layout: Layout, slope: float) -> tuple[Tensor, ...]:
    """As :func:`pinnochio.networks.gatv2_cpu.backward`."""
    (n, width), (score, norm, before) = g.shape, kept
    st, shift, w, a, _, d = inputs
    order, leaving = layout.leaving
    gst, go = torch.empty_like(st), torch.empty_like(g)
    share, slant = torch.empty_like(score), torch.empty_like(score)
    per = triton.cdiv(n, _GROUPS)
    groups = triton.cdiv(n, per)
    sums = g.new_empty(groups, 7, width)
    with torch.cuda.device_of(g):
        _backward_target[(groups,)](
            g, *inputs, layout.source, layout.arriving, score, norm, before, go, share, slant, gst, sums, slope, n, per,
            **_sizes(a),
        )  # fmt: skip
        _backward_source[(n,)](
            st, shift, w, a, d, layout.target, order, leaving, share, slant, go, gst, slope, **_sizes(a)
        )
    total = sums.sum(0)
    return gst, total[6], total[:4], total[4].view_as(a), total[5]


def _sizes(a):
    up, (heads, c) = triton.next_power_of_2, a.shape
    return {"H": heads, "C": c, "HP": up(heads), "CP": up(c), "CHUNK": _CHUNK, "num_warps": _WARPS}


@triton.jit
def _score_inputs(d, w, edges, here, places, inside, width):
    """W d (chunk, heads, channels) of a chunk of edges."""
    total = tl.zeros((edges.shape[0], places.shape[0], places.shape[1]), tl.float32)
    for k in tl.static_range(4):
        along = tl.load(w + k * width + places, mask=inside, other=0.0)
        total += tl.load(d + 4 * edges + k, mask=here, other=0.0)[:, None, None] * along[None, :, :]
    return total


@triton.jit
def _normal(x):
    """Cumulative distribution and density of the standard normal distribution."""
    return 0.5 * (1.0 + tl.erf(x * 0.7071067811865476)), 0.3989422804014327 * tl.exp(-0.5 * x * x)


@triton.jit(do_not_specialize=["slope"])
def _forward(
    x, st, shift, w, a, bias, d, source, arriving, score, norm, before, out, slope,
    H: tl.constexpr, C: tl.constexpr, HP: tl.constexpr, CP: tl.constexpr, CHUNK: tl.constexpr,
):  # fmt: skip
    node = tl.program_id(0)
    width: tl.constexpr = H * C
    heads, channels = tl.arange(0, HP), tl.arange(0, CP)
    places = heads[:, None] * C + channels[None, :]
    inside = (heads[:, None] < H) & (channels[None, :] < C)
    t = tl.load(st + (2 * node + 1) * width + places, mask=inside, other=0.0)
    t += tl.load(shift + places, mask=inside, other=0.0)
    av = tl.load(a + places, mask=inside, other=0.0)
    top = tl.full((HP,), float("-inf"), tl.float32)
    mass = tl.zeros((HP,), tl.float32)
    mean = tl.zeros((HP, CP), tl.float32)
    begin, end = tl.load(arriving + node), tl.load(arriving + node + 1)
    for first in range(begin, end, CHUNK):
        edges = first + tl.arange(0, CHUNK)
        here = edges < end
        j = tl.load(source + edges, mask=here, other=0)
        full = here[:, None, None] & inside[None, :, :]
        s = tl.load(st + (2 * width * j)[:, None, None] + places[None, :, :], mask=full, other=0.0)
        z = s + t[None, :, :] + _score_inputs(d, w, edges, here, places, inside, width)
        e = tl.sum(tl.where(z > 0, z, slope * z) * av[None, :, :], axis=2)
        tl.store(score + edges[:, None] * H + heads[None, :], e, mask=here[:, None] & (heads[None, :] < H))
        e = tl.where(here[:, None], e, float("-inf"))
        peak = tl.maximum(top, tl.max(e, axis=0))
        shrink, p = tl.exp(top - peak), tl.exp(e - peak[None, :])
        mass = mass * shrink + tl.sum(p, axis=0)
        mean = mean * shrink[:, None] + tl.sum(p[:, :, None] * s, axis=0)
        top = peak
    tl.store(norm + node * H + heads, top + tl.log(mass), mask=heads < H)
    o = mean / mass[:, None] + tl.load(bias + places, mask=inside, other=0.0)
    at = node * width + places
    tl.store(before + at, o, mask=inside)
    below, _ = _normal(o)
    tl.store(out + at, tl.load(x + at, mask=inside, other=0.0) + o * below, mask=inside)


@triton.jit(do_not_specialize=["slope", "n", "per"])
def _backward_target(
    g, st, shift, w, a, bias, d, source, arriving, score, norm, before, go, share, slant, gst, sums, slope, n, per,
    H: tl.constexpr, C: tl.constexpr, HP: tl.constexpr, CP: tl.constexpr, CHUNK: tl.constexpr,
):  # fmt: skip
    group = tl.program_id(0)
    width: tl.constexpr = H * C
    heads, channels = tl.arange(0, HP), tl.arange(0, CP)
    places = heads[:, None] * C + channels[None, :]
    inside = (heads[:, None] < H) & (channels[None, :] < C)
    av = tl.load(a + places, mask=inside, other=0.0)
    bv = tl.load(bias + places, mask=inside, other=0.0)
    sh = tl.load(shift + places, mask=inside, other=0.0)
    gw0 = tl.zeros((HP, CP), tl.float32)
    gw1, gw2, gw3, ga, gb, gshift = gw0, gw0, gw0, gw0, gw0, gw0
    for node in range(group * per, tl.minimum(n, group * per + per)):
        at = node * width + places
        o = tl.load(before + at, mask=inside, other=0.0)
        below, density = _normal(o)
        gi = tl.load(g + at, mask=inside, other=0.0) * (below + o * density)
        tl.store(go + at, gi, mask=inside)
        gb += gi
        mean = tl.sum(gi * (o - bv), axis=1)
        peak = tl.load(norm + node * H + heads, mask=heads < H, other=0.0)
        t = tl.load(st + (2 * node + 1) * width + places, mask=inside, other=0.0) + sh
        gt = tl.zeros((HP, CP), tl.float32)
        begin, end = tl.load(arriving + node), tl.load(arriving + node + 1)
        for first in range(begin, end, CHUNK):
            edges = first + tl.arange(0, CHUNK)
            here = edges < end
            both = here[:, None] & (heads[None, :] < H)
            j = tl.load(source + edges, mask=here, other=0)
            full = here[:, None, None] & inside[None, :, :]
            s = tl.load(st + (2 * width * j)[:, None, None] + places[None, :, :], mask=full, other=0.0)
            z = s + t[None, :, :] + _score_inputs(d, w, edges, here, places, inside, width)
            spot = edges[:, None] * H + heads[None, :]
            p = tl.exp(tl.load(score + spot, mask=both, other=float("-inf")) - peak[None, :])
            de = p * (tl.sum(gi[None, :, :] * s, axis=2) - mean[None, :])
            tl.store(slant + spot, de, mask=both)
            tl.store(share + spot, p, mask=both)
            dz = de[:, :, None] * tl.where(z > 0, 1.0, slope)
            ga += tl.sum(dz * z, axis=0)
            dz *= av[None, :, :]
            gt += tl.sum(dz, axis=0)
            d0 = tl.load(d + 4 * edges, mask=here, other=0.0)
            d1 = tl.load(d + 4 * edges + 1, mask=here, other=0.0)
            d2 = tl.load(d + 4 * edges + 2, mask=here, other=0.0)
            d3 = tl.load(d + 4 * edges + 3, mask=here, other=0.0)
            gw0 += tl.sum(d0[:, None, None] * dz, axis=0)
            gw1 += tl.sum(d1[:, None, None] * dz, axis=0)
            gw2 += tl.sum(d2[:, None, None] * dz, axis=0)
            gw3 += tl.sum(d3[:, None, None] * dz, axis=0)
        tl.store(gst + (2 * node + 1) * width + places, gt, mask=inside)
        gshift += gt
    to = sums + group * 7 * width + places
    tl.store(to, gw0, mask=inside)
    tl.store(to + width, gw1, mask=inside)
    tl.store(to + 2 * width, gw2, mask=inside)
    tl.store(to + 3 * width, gw3, mask=inside)
    tl.store(to + 4 * width, ga, mask=inside)
    tl.store(to + 5 * width, gb, mask=inside)
    tl.store(to + 6 * width, gshift, mask=inside)


@triton.jit(do_not_specialize=["slope"])
def _backward_source(
    st, shift, w, a, d, target, order, leaving, share, slant, go, gst, slope,
    H: tl.constexpr, C: tl.constexpr, HP: tl.constexpr, CP: tl.constexpr, CHUNK: tl.constexpr,
):  # fmt: skip
    node = tl.program_id(0)
    width: tl.constexpr = H * C
    heads, channels = tl.arange(0, HP), tl.arange(0, CP)
    places = heads[:, None] * C + channels[None, :]
    inside = (heads[:, None] < H) & (channels[None, :] < C)
    av = tl.load(a + places, mask=inside, other=0.0)
    s = tl.load(st + 2 * node * width + places, mask=inside, other=0.0)
    s += tl.load(shift + places, mask=inside, other=0.0)
    gs = tl.zeros((HP, CP), tl.float32)
    begin, end = tl.load(leaving + node), tl.load(leaving + node + 1)
    for first in range(begin, end, CHUNK):
        spots = first + tl.arange(0, CHUNK)
        here = spots < end
        edges = tl.load(order + spots, mask=here, other=0)
        i = tl.load(target + edges, mask=here, other=0)
        full = here[:, None, None] & inside[None, :, :]
        t = tl.load(st + ((2 * i + 1) * width)[:, None, None] + places[None, :, :], mask=full, other=0.0)
        gi = tl.load(go + (i * width)[:, None, None] + places[None, :, :], mask=full, other=0.0)
        z = s[None, :, :] + t + _score_inputs(d, w, edges, here, places, inside, width)
        both = here[:, None] & (heads[None, :] < H)
        spot = edges[:, None] * H + heads[None, :]
        p = tl.load(share + spot, mask=both, other=0.0)
        de = tl.load(slant + spot, mask=both, other=0.0)
        gs += tl.sum(de[:, :, None] * tl.where(z > 0, 1.0, slope) * av[None, :, :] + p[:, :, None] * gi, axis=0)
    tl.store(gst + 2 * node * width + places, gs, mask=inside)
