"""Finite-element simulation of a plan on a patient: what the FEM methods, the pretraining and the tables share."""

import logging
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace

import numpy as np

from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.kept_factors import RepeatedSolver
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import SolveResult, SolverOptions, solve
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.timing import timed


def solver_options(settings: FemSettings) -> SolverOptions:
    """The solver's part of the settings."""
    return SolverOptions(
        volumetric=settings.volumetric,
        increments=settings.increments,
        tolerance=settings.tolerance,
        max_iterations=settings.max_iterations,
        max_systems=settings.max_systems,
        linear_solver=settings.linear_solver,
        time_limit=settings.time_limit,
        barrier=not settings.yielding,
    )


def simulate(patient: PatientModel, plan: Plan, arm: str, settings: FemSettings, **further) -> SolveResult:
    """Displacement of every node under one plan; arm, settings and further ones as of :class:`PlanSolver`."""
    with closing(PlanSolver(patient, arm, settings, **further)) as solver:
        return solver.solve([plan])[0]


def by_kept_factors(arm: str, settings: FemSettings, unilateral: bool = False) -> bool:
    """Whether plans are solved by kept factors, which know no contact."""
    return settings.kept_factors and not (unilateral or arm == "mucosa+lip")


class PlanSolver:
    """Plans of one patient, for whom what is the same under every plan is made once.

    arm: one of `sliding.ARMS`; unilateral: as in boundary_conditions; loads: forces beside those of the
    elements. With settings.kept_factors by the factors of the stiffness at rest (:mod:`repeated`), and by Newton's
    method what they do not solve; without, and for contact, one after the other by Newton's method.
    device: where plans without loads are solved with kept factors, "cuda" in whole batches (:mod:`batched`).
    preparation: seconds that the patient took.
    """

    def __init__(
        self,
        patient: PatientModel,
        arm: str,
        settings: FemSettings,
        unilateral: bool = False,
        loads: Loads | None = None,
        device: str = "cpu",
    ):
        self._patient, self._arm, self._unilateral, self._loads = patient, arm, unilateral, loads
        self._law, self._options = settings.material(patient.tissue), solver_options(settings)
        self._kept, began = None, time.perf_counter()
        if by_kept_factors(arm, settings, unilateral):
            rest = self._boundary(Plan("rest", {}))
            known = patient.points, patient.cells, self._law, rest, self._options
            try:
                if device == "cpu" or loads:
                    self._kept = RepeatedSolver(*known)
                else:
                    from pinnochio.mechanics.solvers.batched.plan_batches import BatchSolver  # loads torch

                    self._kept = BatchSolver(*known, device)
            except RuntimeError as error:  # the stiffness at rest cannot be factorised
                logging.warning("no kept factors: %s", error)
        self.preparation = time.perf_counter() - began

    def solve(self, plans: Sequence[Plan], forces: Sequence[np.ndarray] | None = None) -> list[SolveResult]:
        """Displacement of every node under each plan; forces: dead forces (n, 3) mN of each, if not that of `loads`."""
        boundaries = [self._boundary(plan) for plan in plans]
        if forces is not None:
            dead = [replace(self._loads, forces=own) if self._loads else Loads(own) for own in forces]
            boundaries = [replace(item, loads=own) for item, own in zip(boundaries, dead, strict=True)]
        if self._kept is not None:
            return self._kept.solve(boundaries)
        mesh = self._patient.points, self._patient.cells
        return [solve(*mesh, self._law, boundary, self._options) for boundary in boundaries]

    def close(self) -> None:
        """Release the factors."""
        if self._kept is not None:
            self._kept.close()

    def _boundary(self, plan: Plan) -> BoundaryConditions:
        boundary = boundary_conditions(self._patient, plan, self._arm, self._unilateral)
        return replace(boundary, loads=self._loads)


def simulate_elastic(patient: PatientModel, plan: Plan, settings: FemSettings) -> tuple[np.ndarray, float, float]:
    """Displacement (n, 3) mm by linear elasticity with sliding interfaces, timed as in `timing.timed`.

    A linear field may hold inverted elements.
    """
    boundary = boundary_conditions(patient, plan, "mucosa")
    with ExitStack() as stack:

        def prepare():
            law = settings.material(patient.tissue)
            solver = ElasticSolver(
                patient.points, patient.cells, law, boundary, settings.volumetric, settings.linear_solver
            )
            stack.callback(solver.close)
            return lambda: solver.solve(boundary)

        return timed(prepare)
