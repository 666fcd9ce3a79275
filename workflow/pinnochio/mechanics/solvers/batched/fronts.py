"""The kept factor of a patient for many plans at once: dense fronts of a nested dissection, level by level.

Of a front, own unknowns s and later ones b, with K_ss = L L' once its children are eliminated, M = [L^-1; -K_bs L^-T
L^-1] is kept. Going up, M z gives the front's own values w and what it adds to later ones; going down, M' [w; y_b] is
its solution. Both ways read the same M, so that the whole is U' U: symmetric and positive definite however coarsely M
is rounded, as a preconditioner has to be.
"""

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from pinnochio.mechanics.solvers.batched.dissection import FrontLevel, dissect
from pinnochio.mechanics.solvers.batched.sparse_rows import SparseRows, gathers


class Fronts:
    """Factors of a symmetric positive definite matrix of blocks (n, n, 3, 3) over points (n, 3) mm, kept in `dtype`."""

    def __init__(self, points, blocks: sparse.bsr_array, device, dtype: torch.dtype = torch.float32):
        count, self.dtype = len(points), dtype
        diagonal = blocks.diagonal().reshape(count, 3)
        if not diagonal.min() > 0:
            raise RuntimeError("the stiffness at rest is not positive definite")
        self._scale = torch.as_tensor(diagonal**-0.5, dtype=dtype, device=device)[:, :, None]
        scale = sparse.diags_array(diagonal.ravel() ** -0.5)
        blocks = sparse.bsr_array(scale @ blocks @ scale, blocksize=(3, 3))
        pattern = sparse.csr_array((np.ones(len(blocks.indices)), blocks.indices, blocks.indptr), (count, count))
        levels = dissect(points, pattern)
        self._matrices = [matrix.to(dtype) for matrix in _factorized(levels, blocks, device)]
        # The rows of one buffer: the loads, then the fronts of each level; of another one: the solutions by level.
        solutions, place = sum(level.pivots.size for level in levels), np.zeros(count, int)
        row, rows, pivot_row = count, [], 0
        for level in levels:
            rows.append(row)
            row += level.pivots.size + level.beside.size
            there = level.pivots >= 0
            place[level.pivots[there]] = pivot_row + np.flatnonzero(there)
            pivot_row += level.pivots.size
        self._rows, self._size, self._solutions = rows, row, solutions
        self._up = [SparseRows(_taken(levels, at, rows, row), device, dtype) for at in range(len(levels))]
        self._down = [
            SparseRows(gathers(_placed(level.beside, place).reshape(-1, 1), solutions), device, dtype)
            for level in levels
        ]
        self._out = SparseRows(gathers(place[:, None], solutions), device, dtype)
        self._shapes = [(len(level.pivots), level.pivots.shape[1], level.beside.shape[1]) for level in levels]

    @property
    def entries(self) -> int:
        """Numbers that are kept."""
        return sum(matrix.numel() for matrix in self._matrices)

    def solve(self, loads: Tensor) -> Tensor:
        """What loads (n, 3, k) cause; on a GPU with the factors rounded to 10 bits."""
        flags, kept = torch.backends.cuda.matmul, torch.backends.cuda.matmul.allow_tf32
        flags.allow_tf32 = True
        try:
            return self._solved(loads)
        finally:
            flags.allow_tf32 = kept

    def _solved(self, loads: Tensor) -> Tensor:
        plans = loads.shape[2]
        buffer = torch.empty(self._size, 3, plans, dtype=self.dtype, device=loads.device)
        solution = torch.empty(self._solutions, 3, plans, dtype=self.dtype, device=loads.device)
        torch.mul(loads, self._scale, out=buffer[: len(loads)])
        kept = []
        for matrix, taken, row, (fronts, pivots, beside) in zip(
            self._matrices, self._up, self._rows, self._shapes, strict=True
        ):
            z = taken(buffer).view(fronts, 3 * (pivots + beside), plans)
            moved = buffer[row : row + fronts * (pivots + beside)].view(fronts, -1, plans)
            torch.bmm(matrix, z[:, : 3 * pivots], out=moved)
            moved[:, 3 * pivots :] += z[:, 3 * pivots :]
            kept.append(moved)
        row = self._solutions
        for matrix, taken, moved, (fronts, pivots, beside) in reversed(
            list(zip(self._matrices, self._down, kept, self._shapes, strict=True))
        ):
            row -= fronts * pivots
            if beside:
                moved[:, 3 * pivots :] = taken(solution).view(fronts, 3 * beside, plans)
            torch.bmm(matrix.mT, moved, out=solution[row : row + fronts * pivots].view(fronts, 3 * pivots, plans))
        return self._out(solution) * self._scale


def _taken(levels: list[FrontLevel], at: int, rows: list[int], size: int) -> sparse.csr_array:
    """Matrix that gathers the values of a level's fronts, own and later unknowns, from loads and children."""
    level = levels[at]
    nodes = np.concatenate([level.pivots, level.beside], axis=1)
    lists = [np.concatenate([level.pivots, np.full_like(level.beside, -1)], axis=1)]
    if at:
        below = levels[at - 1]
        width = below.pivots.shape[1] + below.beside.shape[1]
        for child in level.children.T:
            where = _places(nodes, below.beside[child])
            source = rows[at - 1] + child[:, None] * width + below.pivots.shape[1] + where
            lists.append(np.where(where >= 0, source, -1))
    return gathers(np.stack(lists, axis=-1).reshape(nodes.size, -1), size)


def _placed(nodes, place) -> np.ndarray:
    return np.where(nodes >= 0, place[nodes], -1)


def _places(nodes, members) -> np.ndarray:
    """Place of each node of nodes (f, w) in the row of members (f, m), -1 where it is not there or is none."""
    most = max(nodes.max(initial=0), members.max(initial=0)) + 2
    front = np.arange(len(nodes))[:, None] * most
    keys = (front + np.where(members >= 0, members, most - 1)).ravel()
    order = np.argsort(keys, kind="stable")
    at = np.minimum(np.searchsorted(keys[order], front + nodes), keys.size - 1) if keys.size else None
    if at is None:
        return np.full(nodes.shape, -1)
    hit = order[at]
    return np.where((nodes >= 0) & (keys[hit] == front + nodes), hit % members.shape[1], -1)


def _factorized(levels: list[FrontLevel], blocks: sparse.bsr_array, device) -> list[Tensor]:
    """The matrices M (f, 3 (s + b), 3 s) of each level, in float64."""
    matrices, update, below = [], None, None
    for level in levels:
        (fronts, pivots), beside = level.pivots.shape, level.beside.shape[1]
        nodes = np.concatenate([level.pivots, level.beside], axis=1)
        width = pivots + beside + 1  # the last one takes what belongs nowhere
        whole = torch.zeros(fronts, width, width, 3, 3, dtype=torch.float64, device=device)
        front, row, column, values = _entries(nodes, level.pivots, blocks)
        index = [torch.as_tensor(item, device=device) for item in (front, row, column)]
        values = torch.as_tensor(values, device=device)
        whole[index[0], index[1], index[2]] = values
        whole[index[0], index[2], index[1]] = values.mT
        if below is not None:
            for child in level.children.T:
                where = _places(below.beside[child], nodes)
                where = torch.as_tensor(np.where(where >= 0, where, width - 1), device=device)
                place = torch.arange(fronts, device=device)[:, None, None], where[:, :, None], where[:, None, :]
                whole[place] += update[torch.as_tensor(child, device=device)]
        whole = whole[:, :-1, :-1].permute(0, 1, 3, 2, 4).reshape(fronts, 3 * (width - 1), -1)
        size = 3 * pivots
        empty = torch.as_tensor(np.repeat(level.pivots < 0, 3, axis=1), device=device)
        pivot = whole[:, :size, :size] + torch.diag_embed(empty.double())
        factor, failed = torch.linalg.cholesky_ex(pivot)
        if bool(failed.any()):
            raise RuntimeError("the stiffness at rest is not positive definite to working precision")
        eye = torch.eye(size, dtype=torch.float64, device=device).expand(fronts, -1, -1)
        inverse = torch.linalg.solve_triangular(factor, eye, upper=False)
        coupled = whole[:, size:, :size] @ inverse.mT
        rest = whole[:, size:, size:] - coupled @ coupled.mT
        update, below = rest.reshape(fronts, beside, 3, beside, 3).permute(0, 1, 3, 2, 4), level
        # Padding must neither give nor take.
        inverse = inverse * ~empty[:, :, None]
        matrices.append(torch.cat([inverse, -coupled @ inverse], dim=1))
    return matrices


def _entries(nodes, pivots, blocks: sparse.bsr_array) -> tuple[np.ndarray, ...]:
    """Front, row, column (e,) and values (e, 3, 3) of the matrix's blocks between own nodes and their front."""
    front, row = np.nonzero(pivots >= 0)
    node = pivots[front, row]
    counts = np.diff(blocks.indptr)[node]
    entry = np.repeat(blocks.indptr[node] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts) + np.arange(
        counts.sum()
    )
    front, row = np.repeat(front, counts), np.repeat(row, counts)
    most = len(blocks.indptr)
    keys = (np.arange(len(nodes))[:, None] * most + np.where(nodes >= 0, nodes, most - 1)).ravel()
    order = np.argsort(keys, kind="stable")
    wanted = front * most + blocks.indices[entry]
    at = order[np.minimum(np.searchsorted(keys[order], wanted), len(order) - 1)]
    known = keys[at] == wanted
    return front[known], row[known], at[known] % nodes.shape[1], blocks.data[entry[known]]
