"""Products of a sparse matrix with the arrays of many plans, every row summed in the order of its entries."""

from functools import cache

import numpy as np
import torch
from scipy import sparse
from torch import Tensor


def fused(function):
    """The function, compiled into few kernels where its first argument lies on a GPU and is not empty."""

    @cache
    def compiled():
        return torch.compile(function, dynamic=True)

    def call(first: Tensor, *others):
        return (compiled() if first.is_cuda and first.numel() else function)(first, *others)

    return call


class SparseRows:
    """A sparse matrix (r, c) on a device; dtype: of its values and of what it multiplies."""

    def __init__(self, matrix, device, dtype: torch.dtype):
        matrix = sparse.csr_array(matrix)
        matrix.sort_indices()
        self.shape, self._matrix, self._parts = matrix.shape, None, None
        if torch.device(device).type == "cpu":
            self._matrix = matrix.astype(np.float64 if dtype == torch.float64 else np.float32)
        else:
            values = torch.as_tensor(matrix.data, dtype=dtype, device=device)
            places = (
                torch.as_tensor(item, dtype=torch.int32, device=device) for item in (matrix.indptr, matrix.indices)
            )
            self._parts = *places, values

    def __call__(self, x: Tensor) -> Tensor:
        """The product (r, ...) with x (c, ...)."""
        flat = x.reshape(len(x), -1)
        if self._parts is None:
            return torch.from_numpy(self._matrix @ flat.numpy()).view(self.shape[0], *x.shape[1:])
        from pinnochio.mechanics.solvers.batched import sparse_rows_gpu

        return sparse_rows_gpu.product(*self._parts, flat.contiguous()).view(self.shape[0], *x.shape[1:])


def gathers(lists, columns: int) -> sparse.csr_array:
    """Matrix of ones that sums, for each row, the rows that a list names; lists (r, k), -1 where there is none."""
    row, place = np.nonzero(lists >= 0)
    return sparse.csr_array((np.ones(len(row)), (row, lists[row, place])), (len(lists), columns))
