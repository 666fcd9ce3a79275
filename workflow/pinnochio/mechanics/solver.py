"""Static equilibrium under prescribed and sliding motion: Newton's method with load increments."""

import time
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from pinnochio.errors import InputError
from pinnochio.mechanics.assembly import Assembler
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.linear import linear_solver
from pinnochio.mechanics.materials import Material
from pinnochio.mechanics.sliding import BoundaryConditions, SlidingContact


@dataclass(frozen=True)
class SolverOptions:
    """increments: the first load increment is 1/increments; it grows and shrinks after that.

    tolerance: residual on the free nodes over the reaction on the constrained ones, at the end of the load;
    loose: the same at intermediate loads, which only have to be good starts.
    max_iterations: Newton iterations per increment. time_limit in s. min_increment: share of the load.
    restart: begin again from rest if a given start leads nowhere; else its last iterate is the result.
    """

    volumetric: str = "anp"
    increments: int = 2
    tolerance: float = 1e-6
    loose: float = 1e-2
    max_iterations: int = 25
    min_increment: float = 1 / 256
    time_limit: float = 600.0
    restart: bool = True
    linear_solver: str = "auto"


@dataclass(frozen=True)
class SolveResult:
    """displacement (n, 3) mm: the solution if converged, else the last state in equilibrium, reached at `fraction`.

    reason says why the solver stopped. history: one entry per Newton iterate. residual: relative, at `displacement`.
    violation: largest change of a sliding node's distance to its surface, mm.
    """

    displacement: np.ndarray
    converged: bool
    reason: str
    history: list[dict]
    min_jacobian: float
    fraction: float
    residual: float
    violation: float
    increments: int
    iterations: int
    factorizations: int
    seconds: float


class _Stop(Exception):
    """Ends the solution for good, with its reason."""


@dataclass
class _State:
    """A displacement at a load fraction with its energy, force, residual (relative) and least J."""

    u: np.ndarray
    fraction: float
    energy: float
    force: np.ndarray
    least: float
    frames: np.ndarray
    free_force: np.ndarray
    residual: float


def solve(
    points,
    cells,
    material: Material,
    boundary: BoundaryConditions,
    options: SolverOptions | None = None,
    start: np.ndarray | None = None,
) -> SolveResult:
    """Displacement (n, 3) in mm at which the internal forces of the mesh vanish on every free unknown.

    points (n, 3) mm, cells (m, 4). start (n, 3): a guess at full load, tried first; it may hold inverted elements.
    InputError for input that makes no sense; a problem that is merely hard does not raise, its result says why.
    """
    options = options or SolverOptions()
    if not (options.increments >= 1 and options.tolerance > 0 and 0 < options.min_increment <= 1):
        raise InputError("-", "options", f"{options} makes no sense", "increments >= 1, tolerance > 0")
    newton = _Newton(points, cells, material, boundary, options)
    try:
        return newton.run(start)
    finally:
        newton.linear.close()


class _Newton:
    def __init__(self, points, cells, material, boundary: BoundaryConditions, options: SolverOptions):
        self.began = time.perf_counter()
        self.options, self.boundary = options, boundary
        self.elements = Elements.build(points, cells, material, options.volumetric)
        self.points = np.asarray(points, float)
        self.contact = SlidingContact(self.points, boundary.sliding)
        self.told = np.asarray(boundary.prescribed_nodes, int)
        _check(self.points, self.told, self.contact.nodes, boundary)
        self.constrained = np.zeros((len(self.points), 3), bool)
        self.constrained[self.told] = True
        self.constrained[self.contact.nodes, 0] = True
        _check_held(self.points, self.elements.cells, self.constrained, self.contact)
        self.assembler = Assembler(self.elements, self.constrained, self.contact.nodes)
        self.linear = linear_solver(
            self.assembler.indptr, self.assembler.indices, self.assembler.multipliers, options.linear_solver
        )
        self.history: list[dict] = []
        self.increments = self.iterations = self.factorizations = 0

    # ---- states

    def state(self, u, fraction: float) -> _State:
        """The admissible state next to `u`: prescribed nodes where they belong, sliding nodes on their surfaces."""
        u = self.contact.project(u, fraction)
        u[self.told] = self.boundary.displacement(fraction)
        return self.measured(u, fraction)

    def measured(self, u, fraction: float) -> _State:
        """The state `u` with its residual: forces on the free unknowns over the reactions on the constrained ones."""
        energy, force, least = self.elements.evaluate(u)
        frames = self.contact.frames(u, fraction)
        local = self.local(force, frames)
        free_force = self.assembler.gather(local)
        reaction = np.linalg.norm(local[self.constrained])
        # The reaction at a strain of 1e-4: the measure where the load asks for no force, as in a rigid motion.
        least_reaction = 1e-4 * self.elements.modulus * self.elements.edge**2 * np.sqrt(self.constrained.sum())
        residual = float(np.linalg.norm(free_force) / max(reaction, least_reaction, np.finfo(float).tiny))
        return _State(u, fraction, energy, force, least, frames, free_force, residual)

    def local(self, vectors, frames) -> np.ndarray:
        """Vectors (n, 3) with those of the sliding nodes in their own axes."""
        turned = np.array(vectors)
        turned[self.contact.nodes] = np.einsum("sij,sj->si", frames, turned[self.contact.nodes])
        return turned

    def world(self, vectors, frames) -> np.ndarray:
        """Vectors (n, 3) with those of the sliding nodes back in the common axes."""
        turned = np.array(vectors)
        turned[self.contact.nodes] = np.einsum("sij,si->sj", frames, turned[self.contact.nodes])
        return turned

    def record(self, state: _State, kind: str, step: float = 1.0) -> None:
        self.history.append(
            {
                "kind": kind,
                "step": step,
                "fraction": state.fraction,
                "residual": state.residual,
                "energy": state.energy,
                "min_jacobian": state.least,
            }
        )

    # ---- steps

    def factorize(self, state: _State, step=None) -> np.ndarray:
        """Factorise the tangent, cut to its definite part where it is not; returns its product with `step`."""
        for definite in (False, True):
            if time.perf_counter() - self.began > self.options.time_limit:
                raise _Stop(f"time limit of {self.options.time_limit:g} s reached")
            data, product = self.assembler.tangent(state.u, state.frames, step, definite)
            if not definite:
                bend = self.contact.curvature(state.u, state.fraction, state.frames, state.force)
                self.assembler.add_tangential(data, bend)
            self.factorizations += 1
            if self.linear.factorize(data):
                self.frames = state.frames
                return product
        raise _Stop("the tangent is singular: the boundary condition leaves a part of the mesh loose")

    def correction(self, force) -> np.ndarray:
        """Displacement (n, 3) that the last factors give for forces on the free unknowns."""
        return self.world(self.assembler.scatter(self.linear.solve(-force)), self.frames)

    def predict(self, state: _State, end: float) -> np.ndarray:
        """Displacement increment (n, 3), to first order, up to the load fraction `end`."""
        target = self.contact.project(self.contact.carry(state.u, state.fraction, end), end)
        target[self.told] = self.boundary.displacement(end)
        step = np.where(self.constrained, self.local(target - state.u, state.frames), 0)
        product = self.factorize(state, step)
        return self.correction(state.free_force + product) + self.world(step, state.frames)

    def descend(self, state: _State) -> _State | None:
        """One Newton step with a line search on the energy that turns no element inside out."""
        self.factorize(state)
        self.iterations += 1
        direction = self.correction(state.free_force)
        slope = float(np.einsum("ij,ij->", direction, state.force))
        # Round-off of a sum over all elements; below it the energy cannot tell two states apart.
        noise = 1e-14 * self.elements.modulus * self.elements.volumes.sum() + 1e-13 * abs(state.energy)
        for halvings in range(30):
            step = 0.5**halvings
            new = self.state(state.u + step * direction, state.fraction)
            if new.energy <= state.energy + 1e-4 * step * slope + noise and new.least > _floor(state):
                self.record(new, "newton", step)
                return new
        return None

    def equilibrium(self, state: _State, tolerance: float) -> tuple[_State, str]:
        """Newton iterations at a fixed load: the last state, and "" or why it is not in equilibrium."""
        count = 0
        while state.residual > tolerance:
            # The factors at hand cost nothing: they are used as long as they serve.
            force = self.assembler.gather(self.local(state.force, self.frames))
            new = self.state(state.u + self.correction(force), state.fraction)
            if new.residual < 0.3 * state.residual and new.least > _floor(state):
                self.record(new, "reuse")
                state = new
                continue
            if count == self.options.max_iterations:
                return state, f"{count} Newton iterations left a residual of {state.residual:.1e}"
            new, count = self.descend(state), count + 1
            if new is None:
                return state, f"the line search stagnated at a residual of {state.residual:.1e}"
            state = new
        return state, ""

    # ---- the whole load

    def run(self, start) -> SolveResult:
        if start is not None:
            result = self.tried(self.improve, start)
            if result.converged or not self.options.restart:
                return result
        return self.tried(self.advance, self.measured(np.zeros_like(self.points), 0.0))

    def tried(self, way, begin) -> SolveResult:
        """Result of a way to equilibrium, the last state it reached if it was stopped."""
        try:
            return self.result(*way(begin))
        except _Stop as stop:
            return self.result(self.reached, str(stop))

    def improve(self, start) -> tuple[_State, str]:
        """Equilibrium at full load from a guess (n, 3)."""
        start = np.array(start, float)
        if start.shape != self.points.shape or not np.isfinite(start).all():
            raise InputError("-", "start", f"shape {start.shape} or a value is not finite", "give (n, 3) in mm")
        guess = self.reached = self.measured(start, 1.0)
        if guess.least > 0:
            better = self.state(start + self.predict(guess, 1.0), 1.0)
            self.iterations += 1
        else:
            better = self.state(start, 1.0)
            self.factorize(better)
        self.record(better, "start")
        return self.equilibrium(better, self.options.tolerance)

    def advance(self, state: _State) -> tuple[_State, str]:
        """Equilibrium at full load from the rest state, in increments that shrink on failure and grow on ease."""
        options, share = self.options, 1 / self.options.increments
        while state.fraction < 1:
            self.reached = state
            share = min(share, 1 - state.fraction)
            direction, scale = self.predict(state, state.fraction + share), 1.0
            while True:
                end = 1.0 if scale * share == 1 - state.fraction else state.fraction + scale * share
                new = self.state(state.u + scale * direction, end)
                reason = "an element turned inside out"
                if new.least > 0:
                    self.record(new, "increment", scale)
                    new, reason = self.equilibrium(new, options.tolerance if end == 1 else options.loose)
                if not reason:
                    break
                scale /= 2
                if scale * share < options.min_increment:
                    return state, f"load increment below {options.min_increment:g}: {reason}"
            state, share = new, share * scale * (2 if scale == 1 else 1)
            self.increments += 1
        return state, ""

    def result(self, state: _State, reason: str) -> SolveResult:
        gaps = np.abs(self.contact.violation(state.u, state.fraction))
        return SolveResult(
            displacement=state.u,
            converged=not reason,
            reason=reason or "converged",
            history=self.history,
            min_jacobian=state.least,
            fraction=state.fraction,
            residual=state.residual,
            violation=float(gaps.max(initial=0.0)),
            increments=self.increments,
            iterations=self.iterations,
            factorizations=self.factorizations,
            seconds=time.perf_counter() - self.began,
        )


def _floor(state: _State) -> float:
    """Least J that a step from `state` may reach: an inverted state is free to find its way out."""
    return 0.0 if state.least > 0 else -np.inf


def _check(points, told, sliding, boundary: BoundaryConditions) -> None:
    constrained = np.concatenate([told, sliding])
    if len(constrained) and (constrained.min() < 0 or constrained.max() >= len(points)):
        raise InputError("-", "boundary", "a constrained node does not exist", "mend the node list")
    if len(np.unique(constrained)) != len(constrained):
        raise InputError("-", "boundary", "a node is constrained twice", "give each node one condition")
    for fraction in (0.0, 1.0):
        moved = boundary.displacement(fraction)
        if moved.shape != (len(told), 3) or not np.isfinite(moved).all():
            raise InputError("-", "boundary", f"prescribed motion of shape {moved.shape}", "give (p, 3), finite")


def _check_held(points, cells, constrained, contact: SlidingContact) -> None:
    """Refuse a boundary condition that leaves a connected piece of the mesh a rigid motion, to first order."""
    ends = np.repeat(cells[:, :1], 4, axis=1).ravel(), cells.ravel()
    graph = sparse.coo_matrix((np.ones(cells.size), ends), shape=(len(points),) * 2)
    _, piece = sparse.csgraph.connected_components(graph, directed=False)
    axes = np.tile(np.eye(3), (len(points), 1, 1))
    axes[contact.nodes] = contact.frames(np.zeros_like(points), 0.0)
    node, axis = np.nonzero(constrained)
    direction = axes[node, axis]
    for index in np.unique(piece[cells[:, 0]]):
        own = piece == index
        arm = points - points[own].mean(axis=0)
        arm /= np.linalg.norm(arm[own], axis=1).max()
        held = own[node]
        rows = np.hstack([direction[held], np.cross(arm[node[held]], direction[held])])
        # 1e-6: the squared lever, relative to the piece, below which a hold counts as none.
        if np.linalg.eigvalsh(rows.T @ rows)[0] < 1e-6:
            problem = f"a piece of {own.sum()} of the mesh's nodes is free to move or turn as a whole"
            raise InputError("-", "boundary", problem, "hold three nodes of it, or drop it from the mesh")
