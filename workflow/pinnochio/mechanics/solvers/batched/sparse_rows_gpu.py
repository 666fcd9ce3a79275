"""Sparse matrix times dense matrix on a GPU: one Triton program per few rows and columns, without atomic operations."""

import torch
import triton
import triton.language as tl
from torch import Tensor

_TILE = 256  # numbers of a program


def product(first: Tensor, columns: Tensor, values: Tensor, x: Tensor) -> Tensor:
    """As :class:`pinnochio.mechanics.solvers.batched.sparse_rows.SparseRows`, x (c, w)."""
    rows, width = len(first) - 1, x.shape[1]
    out = x.new_empty(rows, width)
    wide = min(triton.next_power_of_2(width), 64)
    high = max(_TILE // wide, 1)
    with torch.cuda.device_of(x):
        _product[(triton.cdiv(rows, high), triton.cdiv(width, wide))](
            first, columns, values, x, out, rows, width, HIGH=high, WIDE=wide, num_warps=4
        )
    return out


@triton.jit(do_not_specialize=["rows"])
def _product(first, columns, values, x, out, rows, width, HIGH: tl.constexpr, WIDE: tl.constexpr):
    row = tl.program_id(0) * HIGH + tl.arange(0, HIGH)
    column = tl.program_id(1) * WIDE + tl.arange(0, WIDE)
    there, inside = row < rows, column < width
    start = tl.load(first + row, mask=there, other=0)
    count = tl.load(first + row + 1, mask=there, other=0) - start
    total = tl.zeros((HIGH, WIDE), out.dtype.element_ty)
    for k in range(tl.max(count, 0)):
        here = k < count
        source = tl.load(columns + start + k, mask=here, other=0).to(tl.int64)
        value = tl.load(values + start + k, mask=here, other=0.0)
        total += value[:, None] * tl.load(
            x + source[:, None] * width + column[None, :], mask=here[:, None] & inside[None, :], other=0.0
        )
    tl.store(out + row.to(tl.int64)[:, None] * width + column[None, :], total, mask=there[:, None] & inside[None, :])
