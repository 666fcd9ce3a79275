"""Products of a sparse matrix with the arrays of many plans, every row summed in the order of its entries."""

import numpy as np
import torch
from scipy import sparse
from torch import Tensor


def fused(function):
    """The function, compiled into few kernels where its first tensor lies on a GPU."""
    compiled = torch.compile(function, dynamic=True)

    def call(*arguments):
        on_gpu = next(item for item in arguments if isinstance(item, Tensor)).is_cuda
        return (compiled if on_gpu else function)(*arguments)

    return call


class Rows:
    """A sparse matrix (r, c) on a device; dtype: of its values and of what it multiplies."""

    def __init__(self, matrix, device, dtype: torch.dtype):
        matrix = sparse.csr_array(matrix)
        matrix.sort_indices()
        self.shape = matrix.shape
        self._first = torch.as_tensor(matrix.indptr.astype(np.int32), device=device)
        self._columns = torch.as_tensor(matrix.indices.astype(np.int32), device=device)
        self._values = torch.as_tensor(matrix.data, dtype=dtype, device=device)
        self._longest = int(np.diff(matrix.indptr).max(initial=0))
        self._matrix = None
        if self._values.is_cuda:
            return
        self._matrix = torch.sparse_csr_tensor(self._first, self._columns, self._values, matrix.shape)

    def __call__(self, x: Tensor) -> Tensor:
        """The product (r, ...) with x (c, ...)."""
        flat = x.reshape(len(x), -1)
        if self._matrix is not None:
            return (self._matrix @ flat).view(self.shape[0], *x.shape[1:])
        from pinnochio.mechanics.batched import rows_gpu

        out = rows_gpu.product(self._first, self._columns, self._values, flat.contiguous())
        return out.view(self.shape[0], *x.shape[1:])


def gathers(lists, columns: int) -> sparse.csr_array:
    """Matrix of ones that sums, for each row, the rows that a list names; lists (r, k), -1 where there is none."""
    row, place = np.nonzero(lists >= 0)
    return sparse.csr_array((np.ones(len(row)), (row, lists[row, place])), (len(lists), columns))
