"""Newton's method on elements with a pressure unknown, under prescribed motion."""

import time
from dataclasses import dataclass

import numpy as np

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.mixed import FACES, MixedElements
from pinnochio.mechanics.elements.tetrahedra import least_reaction
from pinnochio.mechanics.solvers.linear_algebra import linear_solver


@dataclass(frozen=True)
class MixedResult:
    """displacement (n, 3) mm and pressure (n,) kPa, tension positive, at the corner nodes.

    points, everywhere (k, 3): all nodes, corners first, and their displacement. min_jacobian: at quadrature points.
    If not converged, the last equilibrium, at `fraction` of the load; reason says why it went no further.
    residual: see `solve_mixed`.
    """

    displacement: np.ndarray
    pressure: np.ndarray
    points: np.ndarray
    everywhere: np.ndarray
    converged: bool
    reason: str
    min_jacobian: float
    fraction: float
    residual: float
    iterations: int
    factorizations: int
    seconds: float


def solve_mixed(
    points,
    cells,
    material: Material,
    boundary: BoundaryConditions,
    element: str = "taylor_hood",
    increments: int = 2,
    tolerance: float = 1e-8,
    max_iterations: int = 15,
    min_increment: float = 1 / 256,
    linear_kind: str = "auto",
) -> MixedResult:
    """Equilibrium of points (n, 3) mm and cells (m, 4) under prescribed motion, by Newton's method on (u, q).

    The load grows in increments that are halved on failure and doubled on ease. residual: force on the free unknowns
    over the reaction, plus the volume on which u and q disagree over the volume of the mesh (norms).
    A midside node is prescribed if it lies on a face of the mesh's boundary with three prescribed corners; it moves by
    the mean of its two ends, which is exact for rigid motion. InputError for sliding or contact, and bad input.
    """
    began = time.perf_counter()
    if not (increments >= 1 and tolerance > 0 and 0 < min_increment <= 1):
        raise InputError("-", "options", "increments, tolerance or min_increment makes no sense", "mend them")
    elements = MixedElements(points, cells, material, element)
    problem = _Problem(elements, boundary, linear_kind)
    try:
        state, reason = problem.advance(1 / increments, tolerance, max_iterations, min_increment)
    finally:
        problem.close()
    u, pressure = state.u, elements.pressure(state.q)
    return MixedResult(
        displacement=u[: len(elements.node_volumes)],
        pressure=pressure,
        points=elements.points,
        everywhere=u,
        converged=not reason,
        reason=reason or "converged",
        min_jacobian=state.least,
        fraction=state.fraction,
        residual=state.residual,
        iterations=problem.iterations,
        factorizations=problem.factorizations,
        seconds=time.perf_counter() - began,
    )


@dataclass
class _State:
    """Displacement (k, 3) and q (n,) at a load fraction, gradient of W, least J, residual."""

    u: np.ndarray
    q: np.ndarray
    fraction: float
    gradient: np.ndarray
    least: float
    residual: float


class _Problem:
    """Newton's method on one mesh and one boundary condition."""

    def __init__(self, elements: MixedElements, boundary: BoundaryConditions, kind: str):
        self.elements, self.boundary, self._kind, self._linear = elements, boundary, kind, None
        self.iterations = self.factorizations = 0
        corners, nodes = len(elements.node_volumes), len(elements.points)
        prescribed = np.asarray(boundary.prescribed_nodes, int)
        if boundary.sliding or boundary.contact or boundary.loads:
            problem = "mixed elements know no sliding, no contact and no loads"
            raise InputError("-", "boundary", problem, "prescribe the nodes")
        if (
            len(prescribed) < 3
            or prescribed.min() < 0
            or prescribed.max() >= corners
            or len(np.unique(prescribed)) != len(prescribed)
        ):
            raise InputError("-", "boundary", "prescribed nodes are few, absent or named twice", "mend the node list")
        for fraction in (0.0, 1.0):
            moved = boundary.displacement(fraction)
            if moved.shape != (len(prescribed), 3) or not np.isfinite(moved).all():
                raise InputError("-", "boundary", f"prescribed motion of shape {moved.shape}", "give (p, 3), finite")
        row = np.full(corners, -1)
        row[prescribed] = np.arange(len(prescribed))
        number = {tuple(ends): at for at, ends in enumerate(elements.midside_ends.tolist())}
        faces, uses = np.unique(np.sort(elements.corners[:, FACES], axis=2).reshape(-1, 3), axis=0, return_counts=True)
        bonded = faces[(uses == 1) & (row[faces] >= 0).all(axis=1)] if number else faces[:0]
        pairs = np.unique(bonded[:, [(0, 1), (0, 2), (1, 2)]].reshape(-1, 2), axis=0)
        middle = np.array([corners + number[tuple(ends)] for ends in pairs.tolist()], int)
        # Prescribed nodes and the two rows of the boundary condition that each is the mean of.
        self._prescribed = np.concatenate([prescribed, middle])
        self._rows = np.vstack([np.repeat(np.arange(len(prescribed))[:, None], 2, axis=1), row[pairs]])
        constrained = np.zeros(elements.count, bool)
        constrained[(3 * self._prescribed[:, None] + np.arange(3)).ravel()] = True
        self._constrained, self._free = np.flatnonzero(constrained), np.flatnonzero(~constrained)
        self._start = 3 * nodes  # of q

    def close(self) -> None:
        if self._linear is not None:
            self._linear.close()

    def state(self, u, q, fraction: float) -> _State:
        _, gradient, least = self.elements.evaluate(u, q)
        floor = least_reaction(self.elements, len(self._constrained))
        reaction = max(np.linalg.norm(gradient[self._constrained]), floor)
        force = np.linalg.norm(gradient[self._free[self._free < self._start]])
        gap = np.linalg.norm(gradient[self._start :]) / np.linalg.norm(self.elements.node_volumes)
        return _State(u, q, fraction, gradient, least, float(force / reaction + gap))

    def newton(self, state: _State, end: float) -> _State | None:
        """A Newton step to the load fraction `end`, or none. At the same load it is shortened until J allows it."""
        elements, step = self.elements, np.zeros(self.elements.count)
        du, dq = step[: self._start].reshape(-1, 3), step[self._start :]  # views
        du[self._prescribed] = self.boundary.displacement(end)[self._rows].mean(axis=1) - state.u[self._prescribed]
        matrix, product = elements.tangent(state.u, state.q, step, self._free)
        if self._linear is None:
            self._linear = linear_solver(matrix.indptr, matrix.indices, len(state.q), self._kind)
        self.factorizations += 1
        if not self._linear.factorize(matrix.data):
            return None
        step[self._free] = self._linear.solve(-(state.gradient + product)[self._free])
        for scale in 0.5 ** np.arange(8 if end == state.fraction else 1):
            new = self.state(state.u + scale * du, state.q + scale * dq, end)
            if new.least > elements.material.extension and np.isfinite(new.residual):
                return new
        return None

    def advance(self, share: float, tolerance: float, most: int, least_share: float) -> tuple[_State, str]:
        """The last equilibrium, and "" or why it is not the one at full load."""
        state = self.state(np.zeros_like(self.elements.points), np.zeros(len(self.elements.node_volumes)), 0.0)
        while state.fraction < 1:
            end = min(1.0, state.fraction + share)
            new, count = self.newton(state, end), 0
            while new is not None and new.residual > tolerance and count < most:
                new, count = self.newton(new, end), count + 1
                self.iterations += 1
            if new is not None and new.residual <= tolerance:
                state, share = new, 2 * share
                continue
            share /= 2
            if share < least_share:
                why = "J or the inertia was lost" if new is None else f"residual {new.residual:.1e} after {count} steps"
                return state, f"load increment below {least_share:g}: {why}"
        return state, ""
