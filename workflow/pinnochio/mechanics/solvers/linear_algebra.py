"""Symmetric linear systems of a fixed pattern: PARDISO or SciPy, and conjugate gradients on factors that are kept."""

import copy
import ctypes
import logging
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib import metadata

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from pinnochio.errors import InputError

# pypardiso else searches the whole installation for MKL, at its import and again for a solver, for a second each.
try:
    _MKL = [str(file.locate()) for file in metadata.files("mkl") or () if "mkl_rt" in file.name]
except metadata.PackageNotFoundError:  # not from a wheel
    _MKL = []
if _MKL:
    os.environ.setdefault("PYPARDISO_MKL_RT", _MKL[0])

try:
    from pypardiso import PyPardisoSolver
except ImportError:  # no MKL on this platform
    PyPardisoSolver = None

LOG = logging.getLogger(__name__)
MKL_CBWR_AUTO = 2  # of mkl_cbwr.h: the fastest code path that is reproducible on one machine
LINEAR_SOLVERS = ("auto", "pardiso", "scipy")


def linear_solver(indptr, indices, kind: str = "auto", single: bool = False):
    """Solver for a symmetric, positive definite matrix, upper triangle in CSR.

    factorize(data) is false where the matrix is not definite (then it is not the Hessian at a minimum);
    solve(rhs) uses the last factors, for one right-hand side (s,) or several (k, s); worth: how many solutions a
    factorisation costs; close() releases the factors.
    single: factors in single precision, where the library has them: as good for conjugate gradients, at half the cost.
    """
    if kind not in LINEAR_SOLVERS:
        raise InputError("-", "options", f"linear_solver is {kind!r}", f"choose one of {LINEAR_SOLVERS}")
    if kind == "pardiso" and PyPardisoSolver is None:
        raise InputError("-", "options", "PARDISO is not installed", "pip install pypardiso, or choose 'auto'")
    if kind == "scipy" or PyPardisoSolver is None:
        return Scipy(indptr, indices)
    return Pardiso(indptr, indices, single)


@cache
def _library() -> "PyPardisoSolver":
    """The wrapper, made once."""
    solver = PyPardisoSolver()
    # Conditional numerical reproducibility: with several threads MKL else sums in another order from run to run.
    if solver.libmkl.MKL_CBWR_Set(MKL_CBWR_AUTO):
        LOG.warning("MKL was in use before: results of several threads may differ in their last digits")
    return solver


class Pardiso:
    """MKL PARDISO, Cholesky. The pattern is analysed once."""

    def __init__(self, indptr, indices, single: bool):
        self._size, self._type = len(indptr) - 1, np.float32 if single else np.float64
        self._indptr, self._indices = (np.asarray(x, np.int32) + np.int32(1) for x in (indptr, indices))
        self._data, self._ready = np.zeros(len(indices), self._type), False
        self._solver = copy.copy(_library())
        self._solver.pt, self._solver.iparm = np.zeros(64, np.int64), np.zeros(64, np.int32)
        set_to = self._solver.set_iparm
        set_to(1, 1)  # the values below, not the defaults
        set_to(2, 2)  # METIS
        set_to(18, -1)  # count the entries of the factors
        set_to(19, -1)  # and the operations
        set_to(28, int(single))

    def _call(self, phase: int, rhs: np.ndarray) -> tuple[np.ndarray, int]:
        """Result and error code of one phase; the wrapper's own call copies the pattern each time."""

        def integer(value: int):
            return ctypes.byref(ctypes.c_int32(value))

        def pointer(array: np.ndarray, kind):
            return array.ctypes.data_as(ctypes.POINTER(kind))

        rhs = np.ascontiguousarray(rhs, self._type)
        result, error, solver = np.zeros_like(rhs), ctypes.c_int32(0), self._solver
        # In the order and by the names of MKL's manual. The wrapper declares pointers to double; in single precision
        # the library reads what lies there as float.
        arguments = {
            "pt": pointer(solver.pt, solver._pt_type[0]),
            "maxfct": integer(1),
            "mnum": integer(1),
            "mtype": integer(2),
            "phase": integer(phase),
            "n": integer(self._size),
            "a": pointer(self._data, ctypes.c_double),
            "ia": pointer(self._indptr, ctypes.c_int32),
            "ja": pointer(self._indices, ctypes.c_int32),
            "perm": pointer(solver.perm, ctypes.c_int32),
            "nrhs": integer(rhs.size // self._size),
            "iparm": pointer(solver.iparm, ctypes.c_int32),
            "msglvl": integer(0),
            "b": pointer(rhs, ctypes.c_double),
            "x": pointer(result, ctypes.c_double),
            "error": ctypes.byref(error),
        }
        solver._mkl_pardiso(*arguments.values())
        return result, error.value

    def factorize(self, data) -> bool:
        if not np.isfinite(data).all():
            return False
        self._data = np.ascontiguousarray(data, self._type)
        _, error = self._call(22 if self._ready else 12, np.zeros(self._size))
        self._ready = True
        if error in (-4, -7):  # zero or negative pivot
            return False
        if error:
            raise RuntimeError(f"PARDISO failed with error {error}; -2 means that the machine has too little memory")
        return True

    @property
    def worth(self) -> float:
        # Operations of the factorisation (in millions) over entries read twice in a solution, which is bound by
        # memory; on the machines tried an entry costs as much as 40 operations [X].
        entries, operations = float(self._solver.iparm[17]), 1e6 * float(self._solver.iparm[18])
        return operations / (40 * entries)

    def solve(self, rhs) -> np.ndarray:
        return self._call(33, rhs)[0].astype(float, copy=False)

    def close(self) -> None:
        self._call(-1, np.zeros(self._size))


class Scipy:
    """SuperLU without pivoting, so that its pivots are positive. Slow; for machines without MKL."""

    worth = 20.0

    def __init__(self, indptr, indices):
        self._shape, self._indptr, self._indices = (len(indptr) - 1,) * 2, indptr, indices
        self._factors = None

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
        unpivoted = np.array_equal(self._factors.perm_r, self._factors.perm_c)
        return bool(unpivoted and pivots.min() > 1e-13 * np.abs(pivots).max())

    def solve(self, rhs) -> np.ndarray:
        return self._factors.solve(np.asarray(rhs, float).T).T

    def close(self) -> None:
        self._factors = None


class Workers:
    """Threads that each work by themselves; what they solve is solved by one thread of MKL."""

    def __init__(self, count: int):
        self._pool = ThreadPoolExecutor(count, initializer=_alone) if count > 1 else None

    def each(self, call: Callable, arguments: Iterable[tuple]) -> list:
        """What the call gives for each of the arguments, in their order."""
        if self._pool is None:
            return [call(*argument) for argument in arguments]
        return list(self._pool.map(lambda argument: call(*argument), arguments))

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_) -> None:
        if self._pool is not None:
            self._pool.shutdown()


def _alone() -> None:
    if PyPardisoSolver is not None:
        _library().libmkl.MKL_Set_Num_Threads_Local(1)


def symmetric_product(upper: sparse.csr_matrix) -> Callable[[np.ndarray], np.ndarray]:
    """x -> A x for a symmetric matrix stored as its upper triangle."""
    lower, diagonal = upper.T, upper.diagonal()
    return lambda x: upper @ x + lower @ x - diagonal * x


def conjugate_gradients(product, precondition, rhs, tolerance: float, limit: int) -> tuple[np.ndarray | None, int]:
    """Solution to a relative residual of `tolerance`, None if `limit` iterations or a negative curvature end it before;
    and the iterations made.

    product, precondition: x -> A x and x -> M^-1 x, both symmetric, M positive definite.
    """
    solution, residual = np.zeros_like(rhs), np.array(rhs)
    goal = tolerance * np.linalg.norm(rhs)
    direction, last = None, 0.0
    for iteration in range(limit):
        if np.linalg.norm(residual) <= goal:
            return solution, iteration
        wanted = precondition(residual)
        now = residual @ wanted
        direction = wanted if direction is None else wanted + now / last * direction
        image = product(direction)
        curvature = direction @ image
        if not curvature > 0:
            return None, iteration
        solution += now / curvature * direction
        residual -= now / curvature * image
        last = now
    return (solution if np.linalg.norm(residual) <= goal else None), limit
