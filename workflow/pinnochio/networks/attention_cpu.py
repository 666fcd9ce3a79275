"""One fused loop per node for GATv2 attention on a CPU, forward and backward.

e_ij = a . LeakyReLU(t_i + s_j + W d_ij), softmax over the sources j of i, out_i = sum_j alpha_ij s_j [S:
GATv2]. Edge-sized feature tensors are never stored, which is what slow down the general kernels on one core.
"""

import numba
import numpy as np
import torch
from torch import Tensor

_compile = numba.njit(fastmath={"contract", "reassoc", "nsz", "arcp"}, cache=True, error_model="numpy", nogil=True)


def attend(s, t, w, a, edges: Tensor, d: Tensor, slope: float) -> Tensor:
    """Attention of targets over sources.

    s, t (n, h c) transformed sources and targets; w (h c, 4) edge weight; a (h, c) attention vector; edges
    (2, e) sorted by target; d (e, 4) edge attributes (no gradient). Returns (n, h c).
    """
    return _Attend.apply(s, t, w, a, edges, d, slope)


class _Attend(torch.autograd.Function):
    @staticmethod
    def forward(ctx, s, t, w, a, edges, d, slope):
        shape = (-1, *a.shape)
        tensors = [x.detach().contiguous().view(shape) for x in (s, t, w.T)] + [a.detach(), d]
        rows = torch.searchsorted(edges[1].contiguous(), torch.arange(len(s) + 1)).numpy()
        out, alpha = torch.zeros_like(tensors[0]), torch.empty(edges.shape[1], len(a))
        _forward(*(x.numpy() for x in tensors), edges[0].numpy(), rows, slope, out.numpy(), alpha.numpy())
        ctx.save_for_backward(*tensors, edges, alpha)
        ctx.rows, ctx.slope = rows, slope
        return out.flatten(1)

    @staticmethod
    def backward(ctx, gradient):
        *tensors, edges, alpha = ctx.saved_tensors
        grads = [torch.zeros_like(x) for x in tensors[:4]]
        _backward(
            *(x.numpy() for x in tensors), edges[0].numpy(), ctx.rows, ctx.slope, alpha.numpy(),
            gradient.contiguous().view(tensors[0].shape).numpy(), *(x.numpy() for x in grads),
        )  # fmt: skip
        s, t, w, a = grads
        return s.flatten(1), t.flatten(1), w.flatten(1).T, a, None, None, None


# Indices run from zero and every inner loop writes one array, so that the compiler can use vector instructions.
@_compile
def _forward(s, t, w, a, d, source, rows, slope, out, alpha):
    n, heads, c = s.shape
    slope = np.float32(slope)
    for i in range(n):
        for e in range(rows[i], rows[i + 1]):
            j = source[e]
            d0, d1, d2, d3 = d[e, 0], d[e, 1], d[e, 2], d[e, 3]
            for h in range(heads):
                score = np.float32(0)
                for k in range(c):
                    edge = d0 * w[0, h, k] + d1 * w[1, h, k] + d2 * w[2, h, k] + d3 * w[3, h, k]
                    z = s[j, h, k] + t[i, h, k] + edge
                    score += a[h, k] * (z if z > 0 else slope * z)
                alpha[e, h] = score
        for h in range(heads):
            top = np.float32(-np.inf)
            for e in range(rows[i], rows[i + 1]):
                top = max(top, alpha[e, h])
            total = np.float32(0)
            for e in range(rows[i], rows[i + 1]):
                alpha[e, h] = np.exp(alpha[e, h] - top)
                total += alpha[e, h]
            for e in range(rows[i], rows[i + 1]):
                alpha[e, h] /= total
        for e in range(rows[i], rows[i + 1]):
            j = source[e]
            for h in range(heads):
                weight = alpha[e, h]
                for k in range(c):
                    out[i, h, k] += weight * s[j, h, k]


@_compile
def _backward(s, t, w, a, d, source, rows, slope, alpha, g, gs, gt, gw, ga):
    n, heads, c = s.shape
    slope = np.float32(slope)
    dz = np.empty(c, np.float32)
    score = np.empty(c, np.float32)
    mean = np.empty(heads, np.float32)
    for i in range(n):
        mean[:] = 0
        for e in range(rows[i], rows[i + 1]):
            j = source[e]
            for h in range(heads):
                dot = np.float32(0)
                for k in range(c):
                    dot += g[i, h, k] * s[j, h, k]
                mean[h] += alpha[e, h] * dot
        for e in range(rows[i], rows[i + 1]):
            j = source[e]
            d0, d1, d2, d3 = d[e, 0], d[e, 1], d[e, 2], d[e, 3]
            for h in range(heads):
                weight = alpha[e, h]
                dot = np.float32(0)
                for k in range(c):
                    dot += g[i, h, k] * s[j, h, k]
                ds = weight * (dot - mean[h])
                for k in range(c):
                    edge = d0 * w[0, h, k] + d1 * w[1, h, k] + d2 * w[2, h, k] + d3 * w[3, h, k]
                    z = s[j, h, k] + t[i, h, k] + edge
                    share = ds if z > 0 else ds * slope
                    score[k] = share * z
                    dz[k] = share * a[h, k]
                for k in range(c):
                    ga[h, k] += score[k]
                for k in range(c):
                    gt[i, h, k] += dz[k]
                for k in range(c):
                    gs[j, h, k] += dz[k] + weight * g[i, h, k]
                for k in range(c):
                    gw[0, h, k] += d0 * dz[k]
                for k in range(c):
                    gw[1, h, k] += d1 * dz[k]
                for k in range(c):
                    gw[2, h, k] += d2 * dz[k]
                for k in range(c):
                    gw[3, h, k] += d3 * dz[k]
