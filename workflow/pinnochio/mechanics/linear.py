"""Direct solution of symmetric systems with a fixed pattern and a known inertia: PARDISO, or SciPy without it."""

import copy
import logging
from functools import cache

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from pinnochio.errors import InputError

try:
    from pypardiso import PyPardisoSolver
    from pypardiso.pardiso_wrapper import PyPardisoError
except ImportError:  # no MKL on this platform
    PyPardisoSolver = None

LOG = logging.getLogger(__name__)
MKL_CBWR_AUTO = 2  # of mkl_cbwr.h: the fastest code path that is reproducible on one machine
LINEAR_SOLVERS = ("auto", "pardiso", "scipy")


def linear_solver(indptr, indices, negative: int, kind: str = "auto"):
    """Solver for a symmetric matrix, upper triangle in CSR, with `negative` negative and else positive eigenvalues.

    factorize(data) is false where the matrix has another inertia (then it is not the Hessian at a minimum);
    solve(rhs) uses the last factors; close() releases them.
    """
    if kind not in LINEAR_SOLVERS:
        raise InputError("-", "options", f"linear_solver is {kind!r}", f"choose one of {LINEAR_SOLVERS}")
    if kind == "pardiso" and PyPardisoSolver is None:
        raise InputError("-", "options", "PARDISO is not installed", "pip install pypardiso, or choose 'auto'")
    made = Scipy if kind == "scipy" or PyPardisoSolver is None else Pardiso
    return made(indptr, indices, negative)


@cache
def _library() -> "PyPardisoSolver":
    """The wrapper, made once: it searches the whole installation for MKL, which takes a second."""
    solver = PyPardisoSolver()
    # Conditional numerical reproducibility: with several threads MKL else sums in another order from run to run.
    if solver.libmkl.MKL_CBWR_Set(MKL_CBWR_AUTO):
        LOG.warning("MKL was in use before: results of several threads may differ in their last digits")
    return solver


class Pardiso:
    """MKL PARDISO: Cholesky without negative eigenvalues, else LDL'. The pattern is analysed once."""

    def __init__(self, indptr, indices, negative: int):
        self._matrix = sparse.csr_matrix((np.zeros(len(indices)), indices, indptr), shape=(len(indptr) - 1,) * 2)
        self._negative = negative
        self._solver = copy.copy(_library())
        self._solver.pt, self._solver.iparm = np.zeros(64, np.int64), np.zeros(64, np.int32)
        self._solver.set_matrix_type(-2 if negative else 2)
        set_to = self._solver.set_iparm
        set_to(1, 1)  # the values below, not the defaults
        set_to(2, 2)  # METIS
        set_to(10, 13)  # pivots below 1e-13 of the norm are perturbed; factorize() then says no
        set_to(18, 0)
        self._ready = False

    def _call(self, phase: int, rhs: np.ndarray) -> np.ndarray:
        self._solver.set_phase(phase)
        return self._solver._call_pardiso(self._matrix, rhs)

    def factorize(self, data) -> bool:
        self._matrix.data = data
        if not np.isfinite(data).all():
            return False
        try:
            if not self._ready:
                self._call(11, np.zeros(self._matrix.shape[0]))
                self._ready = True
            self._call(22, np.zeros(self._matrix.shape[0]))
        except PyPardisoError as error:
            if error.value in (-4, -7):  # zero or negative pivot
                return False
            raise
        iparm = self._solver.iparm
        return not self._negative or bool(iparm[13] == 0 and iparm[22] == self._negative)

    def solve(self, rhs) -> np.ndarray:
        return self._call(33, np.ascontiguousarray(rhs, float))

    def close(self) -> None:
        self._solver.free_memory(everything=True)


class Scipy:
    """SuperLU without pivoting, so that the signs of its pivots are the inertia. Slow; for machines without MKL."""

    def __init__(self, indptr, indices, negative: int):
        self._shape, self._indptr, self._indices = (len(indptr) - 1,) * 2, indptr, indices
        self._negative, self._factors = negative, None

    def factorize(self, data) -> bool:
        if not np.isfinite(data).all():
            return False
        upper = sparse.csr_matrix((data, self._indices, self._indptr), shape=self._shape)
        matrix = (upper + sparse.triu(upper, 1).T).tocsc()
        try:
            self._factors = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:  # exactly singular
            return False
        pivots = self._factors.U.diagonal()
        smallest = 1e-13 * np.abs(pivots).max()
        unpivoted = np.array_equal(self._factors.perm_r, self._factors.perm_c)
        return bool(unpivoted and np.abs(pivots).min() > smallest and np.count_nonzero(pivots < 0) == self._negative)

    def solve(self, rhs) -> np.ndarray:
        return self._factors.solve(np.asarray(rhs, float))

    def close(self) -> None:
        self._factors = None
