"""Static equilibrium under prescribed and sliding motion: Newton's method with load increments."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.constraints import Constraints
from pinnochio.mechanics.boundary.contact import UnilateralContact, penalty
from pinnochio.mechanics.boundary.loads import OuterForces
from pinnochio.mechanics.elements.assembly import Assembler
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import Elements, jacobians, least_reaction
from pinnochio.mechanics.settings import SolverSettings
from pinnochio.mechanics.solvers.linear_algebra import conjugate_gradients, linear_solver, symmetric_product

# Volume ratio below which ln J is extended while a start is untangled: the energy is all but quadratic in J then. With
# 0.3 a patch mesh whose elements were half inverted reached another equilibrium in 1 of 12 tries, with 0.9 in none [X].
UNTANGLING = 0.9
# A start with a larger share of inverted elements says nothing of where to go: plain elements settle in a crumpled
# equilibrium from there [X].
TANGLED = 0.25


@dataclass(frozen=True)
class SolveResult:
    """displacement (n, 3) mm: the solution if converged, else the last state in equilibrium, reached at `fraction`.

    reason says why the solver stopped. history: one entry per Newton iterate. residual: relative, at `displacement`.
    violation: largest change of a sliding node's distance to its surface, mm; penetration, gap: how far a contact node
    has entered the opposing surface, or come away from it, at most, mm. kept: solved by the patient's kept factors.
    """

    displacement: np.ndarray
    converged: bool
    reason: str
    history: list[dict]
    min_jacobian: float
    fraction: float
    residual: float
    violation: float
    penetration: float
    gap: float
    increments: int
    iterations: int
    factorizations: int
    linear_iterations: int
    seconds: float
    kept: bool = False

    @classmethod
    def linear(cls, displacement: np.ndarray, least: float, seconds: float) -> "SolveResult":
        """A field (n, 3) mm of linear elasticity, whose residual is not measured."""
        counts = dict.fromkeys(("increments", "iterations", "factorizations", "linear_iterations"), 0)
        lengths = dict.fromkeys(("violation", "penetration", "gap", "residual"), np.nan)
        return cls(displacement, True, "linear", [], least, 1.0, seconds=seconds, **lengths, **counts)


class Stop(Exception):
    """Ends the solution for good, with its reason."""


@dataclass
class NewtonState:
    """A displacement at a load fraction with its energy, force, residual (relative) and least J."""

    u: np.ndarray
    fraction: float
    energy: float
    force: np.ndarray
    least: float
    frames: np.ndarray
    free_force: np.ndarray
    residual: float


class Direction(NamedTuple):
    """Motion (n, 3) mm of a Newton step, and whether it is that of the tangent cut to its definite part."""

    motion: np.ndarray
    cut: bool


def solve(
    points,
    cells,
    material: Material,
    boundary: BoundaryConditions,
    settings: SolverSettings,
    start: np.ndarray | None = None,
) -> SolveResult:
    """Displacement (n, 3) in mm at which the internal forces of the mesh vanish on every free unknown.

    points (n, 3) mm, cells (m, 4). start (n, 3): a guess at full load, tried first; it may hold inverted elements.
    InputError for input that makes no sense; a problem that is merely hard does not raise, its result says why.
    """
    sound = settings.increments >= 1 and settings.growth >= 1 and settings.tolerance > 0
    if not (sound and 0 < settings.min_increment <= 1):
        raise InputError("-", "options", f"{settings} makes no sense", "increments, growth >= 1, tolerance > 0")
    newton = Newton(points, cells, material, boundary, settings)
    try:
        return newton.run(start)
    finally:
        newton.close()


class Newton:
    """Newton's method on one mesh under one boundary condition: states, steps, and the way to the whole load."""

    def __init__(self, points, cells, material, boundary: BoundaryConditions, settings: SolverSettings):
        self.began = time.perf_counter()
        self.settings = settings
        self.elements = Elements.build(points, cells, material, settings.volumetric)
        self.points = np.asarray(points, float)
        self.constraints = Constraints(self.points, self.elements.cells, boundary)
        self.sliding = self.constraints.sliding
        stiffness = penalty(self.elements.modulus, self.elements.edge)
        self.contact = UnilateralContact(self.points, boundary.contact, stiffness)
        self.outer = OuterForces(self.points, boundary.loads)
        constrained = self.constraints.constrained
        couplings = np.concatenate([self.contact.pairs, self.outer.pairs])
        self.assembler = Assembler(self.elements, constrained, self.sliding.nodes, couplings)
        self.systems = {}
        self.single, self.factorized, self.indefinite, self.spent = settings.reuse, False, False, 0
        self.history: list[dict] = []
        self.increments = self.iterations = self.solved = self.factorizations = self.linear_iterations = 0

    # ---- states

    def state(self, u, fraction: float) -> NewtonState:
        """The admissible state next to `u`: prescribed nodes where they belong, sliding nodes on their surfaces."""
        return self.measured(self.constraints.met(u, fraction), fraction)

    def measured(self, u, fraction: float) -> NewtonState:
        """The state `u` with its residual: forces on the free unknowns over the reactions on the constrained ones."""
        energy, force, least = self.elements.evaluate(u)
        pressing, push = self.contact.evaluate(u)
        loaded, pull = self.outer.evaluate(u, fraction)
        energy, force = energy + pressing + loaded, force + push + pull
        frames = self.sliding.at(fraction).frames(u)
        local = self.constraints.local(force, frames)
        free_force = self.assembler.gather(local)
        constrained = self.constraints.constrained
        # Contact carries load too, where the nodes that it presses have no other condition.
        reaction = np.sqrt((local[constrained] ** 2).sum() + (push**2).sum())
        residual = float(np.linalg.norm(free_force) / max(reaction, least_reaction(self.elements, constrained.sum())))
        return NewtonState(u, fraction, energy, force, least, frames, free_force, residual)

    def record(self, state: NewtonState, kind: str, step: float = 1.0) -> None:
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

    def direction(
        self, state: NewtonState, tolerance: float, step=None, pressure=None, cut_below: float = 0.0, further=0.0
    ) -> Direction:
        """What takes the state to equilibrium, to first order, while `step` (n, 3, local axes) is imposed on the
        constrained unknowns: by the factors at hand and conjugate gradients to `tolerance` if they serve, else by new
        ones, of the tangent cut to its definite part where it is not definite.

        pressure (p,) kPa: of each patch, for the tangent; by default that of its volume. cut_below: elements with J
        below it, or above its inverse, have their Hessian cut from the start. further: share of the dead load that
        comes on in the step. Raises Stop.
        """
        coming = self.assembler.gather(self.constraints.local(further * self.outer.forces, state.frames))
        for bound in (cut_below, 1.0):
            definite = bound == 1
            if time.perf_counter() - self.began > self.settings.time_limit:
                raise Stop(f"time limit of {self.settings.time_limit:g} s reached")
            if self.solved == self.settings.max_systems:
                raise Stop(f"{self.solved} linear systems did not lead to equilibrium")
            self.solved += 1
            data, product = self.assembler.tangent(
                state.u, state.frames, step, definite=bound, pressure=pressure, elements=self.elements
            )
            if not definite:
                held, nodes = self.sliding.at(state.fraction), self.sliding.nodes
                curvature = held.curvature(state.u, state.frames, state.force[nodes])
                self.assembler.add(data, np.repeat(nodes[:, None], 2, axis=1), curvature)
            pairs, blocks = self.contact.tangent(state.u)
            self.assembler.add(data, pairs, self.constraints.turned(blocks, pairs, state.frames))
            if len(self.outer.pairs):
                tense = self.constraints.turned(self.outer.blocks, self.outer.pairs, state.frames)
                self.assembler.add(data, self.outer.pairs, tense)
            unknowns = self.solution(data, coming - (state.free_force + product), tolerance, definite)
            if unknowns is not None:
                local = self.assembler.scatter(unknowns) + (0 if step is None else step)
                return Direction(self.constraints.world(local, state.frames), definite)
        raise Stop("the tangent is singular: the boundary condition leaves a part of the mesh loose")

    def solution(self, data, force, tolerance: float, definite: bool) -> np.ndarray | None:
        """Solution for the tangent with values `data`, which is `definite`, or None if it turns out not to be."""
        if self.single:
            product = symmetric_product(self.assembler.upper(data))
            # Old factors serve until conjugate gradients have cost as much as new ones would.
            for fresh in (False, True) if self.factorized and self.spent < self.linear.worth else (True,):
                if fresh and not self.factorize(data):
                    break
                limit = 20 if fresh else int(np.clip(self.linear.worth, 8, 60))
                unknowns, iterations = conjugate_gradients(product, self.linear.solve, force, tolerance, limit)
                self.linear_iterations += iterations
                self.spent += iterations
                if unknowns is not None:
                    self.indefinite &= definite
                    return unknowns
            if self.indefinite and not definite:
                return None
            self.single = False
        if self.factorize(data):
            return self.linear.solve(force)
        # Indefinite, not merely too ill-conditioned for single precision: no reason to leave that, nor to ask again as
        # long as it fails.
        self.single, self.indefinite = self.settings.reuse, True
        return None

    def factorize(self, data) -> bool:
        self.factorizations += 1
        self.factorized, self.spent = self.linear.factorize(data), 0
        return self.factorized

    @property
    def linear(self):
        """The linear solver of the precision in use; its pattern is analysed once."""
        if self.single not in self.systems:
            self.systems[self.single] = linear_solver(
                self.assembler.indptr, self.assembler.indices, self.settings.linear_solver, self.single
            )
        return self.systems[self.single]

    def forget(self) -> None:
        """Take nothing over from the steps before: no factors, nothing that they showed of the tangent, no count."""
        self.single, self.factorized, self.indefinite, self.solved = self.settings.reuse, False, False, 0

    def close(self) -> None:
        """Release the factors."""
        for system in self.systems.values():
            system.close()

    def predict(self, state: NewtonState, end: float, pressure=None, cut_below: float = 0.0) -> Direction:
        """The step, to first order, up to the load fraction `end`; pressure, cut_below: as in :meth:`direction`."""
        target = self.constraints.met(self.sliding.carry(state.u, state.fraction, end), end)
        local = self.constraints.local(target - state.u, state.frames)
        step = np.where(self.constraints.constrained, local, 0)
        return self.direction(state, 1e-3, step, pressure, cut_below, end - state.fraction)

    def descend(self, state: NewtonState) -> NewtonState | None:
        """One Newton step with a line search on the energy that turns no element inside out."""
        self.iterations += 1
        direction, cut = self.direction(state, 1e-2)
        slope = float(np.einsum("ij,ij->", direction, state.force))
        for halvings in range(30):
            step = 0.5**halvings
            new = self.state(state.u + step * direction, state.fraction)
            if self.falls(state, new, step * slope) and new.least > self.least_allowed(state):
                break
        else:
            return None
        # Off a saddle the definite part makes steps that are far too short: on as long as it goes down well.
        while cut and 1 <= step < 64:
            further = self.state(state.u + 2 * step * direction, state.fraction)
            if further.energy > new.energy + 1e-1 * step * slope or further.least <= self.least_allowed(state):
                break
            new, step = further, 2 * step
        self.record(new, "newton", step)
        return new

    def falls(self, state: NewtonState, new: NewtonState, expected: float) -> bool:
        """Whether the energy falls from one state to the next by some share of what is expected to first order."""
        return new.energy <= state.energy + 1e-4 * expected + self.elements.noise(state.energy)

    def least_allowed(self, state: NewtonState) -> float:
        """Least J that a step from `state` may reach: an inverted state is free to find its way out."""
        return 0.0 if self.settings.barrier and state.least > 0 else -np.inf

    def equilibrium(self, state: NewtonState, tolerance: float) -> tuple[NewtonState, str]:
        """Newton iterations at a fixed load: the last state, and "" or why it is not in equilibrium."""
        count = 0
        while state.residual > tolerance:
            if count == self.settings.max_iterations:
                return state, f"{count} Newton iterations left a residual of {state.residual:.1e}"
            new, count = self.descend(state), count + 1
            if new is None:
                return state, f"the line search stagnated at a residual of {state.residual:.1e}"
            state = new
        return state, ""

    # ---- the whole load

    def run(self, start) -> SolveResult:
        if start is not None:
            start = np.array(start, float)
            if start.shape != self.points.shape or not np.isfinite(start).all():
                raise InputError("-", "start", f"shape {start.shape} or a value is not finite", "give (n, 3) in mm")
        if start is not None and not (self.settings.restart and self.tangled(start)):
            state, reason = self.improve(start)
            if self.settings.barrier and not reason and not state.least > 0:
                # The extended law has equilibria with elements inside out.
                reason = f"the start leads to an equilibrium with elements inside out, J down to {state.least:.2g}"
            result = self.result(state, reason)
            if result.converged or not self.settings.restart:
                return result
        return self.result(*self.advance(self.measured(np.zeros_like(self.points), 0.0)))

    def tangled(self, start) -> bool:
        return (jacobians(self.points, self.elements.cells, start) <= 0).mean() > TANGLED

    def improve(self, start) -> tuple[NewtonState, str]:
        """Equilibrium at full load from a guess (n, 3), the guess if the way there was stopped; and "" or why."""
        guess = self.measured(start, 1.0)
        try:
            if guess.least > 0 or not self.settings.barrier:
                better = self.state(start + self.predict(guess, 1.0).motion, 1.0)
                self.iterations += 1
            else:
                better = self.untangled(self.state(start, 1.0))
            self.record(better, "start")
            return self.equilibrium(better, self.settings.tolerance)
        except Stop as stop:
            return guess, str(stop)

    def untangled(self, state: NewtonState) -> NewtonState:
        """The state that an energy without a barrier leads to: it pushes elements from far inside out."""
        elements = self.elements
        self.elements = elements.with_extension(UNTANGLING)
        try:
            state, _ = self.equilibrium(self.measured(state.u, state.fraction), self.settings.loose)
        finally:
            self.elements = elements
        return self.measured(state.u, state.fraction)

    def advance(self, state: NewtonState) -> tuple[NewtonState, str]:
        """Equilibrium at full load from the rest state, in increments that shrink on failure and grow on ease; the last
        equilibrium if the way there was stopped; and "" or why."""
        share = 1 / self.settings.increments
        try:
            while state.fraction < 1:
                share = min(share, 1 - state.fraction)
                state, scale = self.increment(state, share)
                share *= scale * (self.settings.growth if scale == 1 else 1)
                self.increments += 1
        except Stop as stop:
            return state, str(stop)
        return state, ""

    def increment(self, state: NewtonState, share: float) -> tuple[NewtonState, float]:
        """Equilibrium after a share of the load, and by how much that had to be scaled down. Raises Stop."""
        settings, scale = self.settings, 1.0
        motion = self.predict(state, state.fraction + share).motion
        while True:
            end = 1.0 if scale * share == 1 - state.fraction else state.fraction + scale * share
            new = self.state(state.u + scale * motion, end)
            reason = "an element turned inside out"
            if new.least > self.least_allowed(state):
                self.record(new, "increment", scale)
                new, reason = self.equilibrium(new, settings.tolerance if end == 1 else settings.loose)
            if not reason:
                return new, scale
            scale /= 2
            if scale * share < settings.min_increment:
                raise Stop(f"load increment below {settings.min_increment:g}: {reason}")

    def result(self, state: NewtonState, reason: str) -> SolveResult:
        violation = np.abs(self.sliding.at(state.fraction).violation(state.u))
        gaps = self.contact.gaps(state.u)
        return SolveResult(
            displacement=state.u,
            converged=not reason,
            reason=reason or "converged",
            history=self.history,
            min_jacobian=state.least,
            fraction=state.fraction,
            residual=state.residual,
            violation=float(violation.max(initial=0.0)),
            penetration=float(-gaps.min(initial=0.0)),
            gap=float(gaps.max(initial=0.0)),
            increments=self.increments,
            iterations=self.iterations,
            factorizations=self.factorizations,
            linear_iterations=self.linear_iterations,
            seconds=time.perf_counter() - self.began,
        )
