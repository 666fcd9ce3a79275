"""The graph-attention layer on a CPU: compiled loops over the edges of each node, forward and backward.

e_ij = a . LeakyReLU(t_i + s_j + W d_ij), alpha_ij its softmax over the sources j of i, y_i = x_i + GELU(b + sum_j
alpha_ij s_j) [S: GATv2]. Nothing of the size edges x channels is stored, which is what slows down the general kernels.
The loops run over targets; each target is computed by one thread in one order, whatever their number.
"""

import functools
import itertools
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor

from pinnochio.compiled import compiled
from pinnochio.networks.layout import Inputs, Layout
from pinnochio.networks.vectors import (
    element,
    exponential,
    larger,
    largest,
    load,
    positive,
    scaled,
    spread,
    store,
    total,
)

_LANES = 8  # of the softmax, whose vectors run along the edges; all others run along the channels of a head
_SHARE = 512  # least targets per thread: below, handing work to a thread costs more than the work
_ZERO, _HALF, _ONE, _LOWEST = (np.float32(x) for x in (0, 0.5, 1, -np.inf))
# Standard normal distribution by Abramowitz and Stegun 7.1.26, to 1e-7.
_ROOT, _DENSITY, _P = (np.float32(x) for x in (0.5**0.5, (2 * np.pi) ** -0.5, 0.3275911))
_A = tuple(np.float32(x) for x in (0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429))


class _Gradients(NamedTuple):
    """Gradients by what :class:`Inputs` calls by the same names."""

    st: np.ndarray
    shift: np.ndarray
    w: np.ndarray
    a: np.ndarray
    bias: np.ndarray


def forward(x, inputs: Inputs, layout: Layout, slope: float) -> tuple[Tensor, ...]:
    """The layer's output (n, h c), and what :func:`backward` asks for as `kept`.

    x (n, h c) nodes, float32 and contiguous; slope of the leaky ReLU.
    """
    run, _ = _loops(*inputs.a.shape)
    nodes, arrays, (source, rows) = x.detach().numpy(), _arrays(inputs), _edges(layout)
    slope = np.float32(slope)
    # numpy's empty arrays: torch's are filled where it has to be deterministic
    shapes = (len(inputs.a), len(inputs.d)), x.shape, x.shape
    alpha, before, out = (np.empty(shape, np.float32) for shape in shapes)
    _spread_over_threads(
        lambda first, last: run(nodes, arrays, source, rows, slope, first, last, alpha, before, out), len(x)
    )
    return torch.from_numpy(out), torch.from_numpy(alpha), torch.from_numpy(before)


def backward(g, inputs: Inputs, kept, layout: Layout, slope: float) -> list[Tensor]:
    """Gradients by st, shift, w, a and bias from that by the output, g (n, h c)."""
    _, run = _loops(*inputs.a.shape)
    arrays, (source, rows), (alpha, before) = _arrays(inputs), _edges(layout), kept
    mean = np.empty((len(g), len(inputs.a)), np.float32)
    summed = [np.zeros_like(array) for array in (arrays.shift, arrays.w, arrays.a, arrays.bias)]
    gradients = _Gradients(np.empty_like(arrays.st), *summed)
    run(arrays, source, rows, np.float32(slope), alpha.numpy(), before.numpy(), g.numpy(), mean, gradients)
    return [torch.from_numpy(array) for array in gradients]


def _arrays(inputs: Inputs) -> Inputs:
    """The same as arrays of NumPy."""
    return Inputs(*(tensor.detach().numpy() for tensor in inputs))


def _edges(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Sources, and where those of each node begin."""
    return layout.source.numpy(), layout.arriving.numpy()


@functools.lru_cache
def _pool(threads):
    return ThreadPoolExecutor(threads)


def _spread_over_threads(part, count):
    """part(first, last) over ranges of `count` targets, on as many threads as torch may use."""
    threads = max(1, min(torch.get_num_threads(), count // _SHARE))
    bounds = [count * i // threads for i in range(threads + 1)]
    if threads == 1:
        part(0, count)
        return
    others = [_pool(threads - 1).submit(part, *pair) for pair in itertools.pairwise(bounds[1:])]
    part(0, bounds[1])
    for other in others:
        other.result()


_inline = njit(error_model="numpy", forceinline=True)
_jit = compiled(error_model="numpy")


@_inline
def _normal(x):
    """Cumulative distribution and density of the standard normal distribution."""
    bell = exponential(x * x * -_HALF)
    t = _ONE / (positive(x, x, x * -_ONE) * (_ROOT * _P) + _ONE)
    tail = ((((t * _A[4] + _A[3]) * t + _A[2]) * t + _A[1]) * t + _A[0]) * t * bell * _HALF
    return positive(x, tail * -_ONE + _ONE, tail), bell * _DENSITY


@functools.lru_cache
def _loops(heads, c):
    """The two loops, compiled for this number of heads and of channels per head."""
    width = heads * c

    @_jit
    def forward(x, inputs, source, rows, slope, first, last, alpha, before, out):
        st, shift, w, a, bias, d = inputs
        most = 0
        for i in range(first, last):
            most = max(most, rows[i + 1] - rows[i])
        size = (most // _LANES + 1) * _LANES
        scores = np.empty(heads * size, np.float32)  # of one target
        for i in range(first, last):
            begin, count = element(rows, i), element(rows, i + 1) - element(rows, i)
            for h in range(heads):
                at = h * c
                t = load(st, (2 * i + 1) * width + at, c) + load(shift, at, c)
                w0, w1, w2 = load(w, at, c), load(w, at + width, c), load(w, at + 2 * width, c)
                w3, ah = load(w, at + 3 * width, c), load(a, at, c)
                store(scores, h * size + (count - 1) // _LANES * _LANES, spread(_LOWEST, _LANES))
                for k in range(count):
                    e = begin + k
                    z = load(st, 2 * width * element(source, e) + at, c) + t
                    z = z + scaled(d, 4 * e, w0) + scaled(d, 4 * e + 1, w1) + scaled(d, 4 * e + 2, w2)
                    z = z + scaled(d, 4 * e + 3, w3)
                    scores[h * size + k] = total(ah * larger(z, z * slope))
            for h in range(heads):
                top, norm = spread(_LOWEST, _LANES), spread(_ZERO, _LANES)
                for k in range(h * size, h * size + count, _LANES):
                    top = larger(top, load(scores, k, _LANES))
                top = -largest(top)
                for k in range(h * size, h * size + count, _LANES):
                    share = exponential(load(scores, k, _LANES) + top)
                    store(scores, k, share)
                    norm = norm + share
                inverse = _ONE / total(norm)
                for k in range(h * size, h * size + count, _LANES):
                    store(scores, k, load(scores, k, _LANES) * inverse)
            for h in range(heads):
                o = load(bias, h * c, c)
                for k in range(count):
                    alpha[h, begin + k] = element(scores, h * size + k)
                    o = o + scaled(scores, h * size + k, load(st, 2 * width * element(source, begin + k) + h * c, c))
                store(before, i * width + h * c, o)
                below, _ = _normal(o)
                store(out, i * width + h * c, load(x, i * width + h * c, c) + o * below)

    @_jit
    def backward(inputs, source, rows, slope, alpha, before, g, mean, gradients):
        st, shift, w, a, bias, d = inputs
        gst, gshift, gw, ga, gb = gradients
        edges, n = len(d), len(before)
        for i in range(n):
            for h in range(heads):
                at = i * width + h * c
                o = load(before, at, c)
                below, density = _normal(o)
                go = load(g, at, c) * (below + o * density)
                mean[i, h] = total(go * (o + load(bias, h * c, c) * -_ONE))
                store(gb, h * c, load(gb, h * c, c) + go)
                store(gst, at + i * width, spread(_ZERO, c))
                store(gst, at + (i + 1) * width, go)  # until the gradient of the target takes its place
        for i in range(n):
            for h in range(heads):
                at, here = h * c, (2 * i + 1) * width + h * c
                t, go = load(st, here, c) + load(shift, at, c), load(gst, here, c)
                w0, w1, w2 = load(w, at, c), load(w, at + width, c), load(w, at + 2 * width, c)
                w3, ah = load(w, at + 3 * width, c), load(a, at, c)
                gt = g0 = g1 = g2 = g3 = gah = spread(_ZERO, c)
                for e in range(rows[i], rows[i + 1]):
                    j = 2 * width * source[e] + at
                    s = load(st, j, c)
                    z = s + t + scaled(d, 4 * e, w0) + scaled(d, 4 * e + 1, w1) + scaled(d, 4 * e + 2, w2)
                    z = z + scaled(d, 4 * e + 3, w3)
                    score = alpha[h, e] * (total(go * s) - mean[i, h])
                    slant = positive(z, spread(score, c), spread(score * slope, c))
                    gah = gah + slant * z
                    dz = slant * ah
                    gt = gt + dz
                    g0, g1 = g0 + scaled(d, 4 * e, dz), g1 + scaled(d, 4 * e + 1, dz)
                    g2, g3 = g2 + scaled(d, 4 * e + 2, dz), g3 + scaled(d, 4 * e + 3, dz)
                    store(gst, j, load(gst, j, c) + dz + scaled(alpha, h * edges + e, go))
                store(gst, here, gt)
                store(gshift, at, load(gshift, at, c) + gt)
                store(ga, at, load(ga, at, c) + gah)
                store(gw, at, load(gw, at, c) + g0)
                store(gw, at + width, load(gw, at + width, c) + g1)
                store(gw, at + 2 * width, load(gw, at + 2 * width, c) + g2)
                store(gw, at + 3 * width, load(gw, at + 3 * width, c) + g3)

    return forward, backward
