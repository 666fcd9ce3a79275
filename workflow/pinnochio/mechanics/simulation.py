"""Finite-element simulation of a plan on a patient: what the FEM methods, the pretraining and the tables share."""

import logging
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.loads import Loads
from pinnochio.mechanics.repeated import RepeatedSolver
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.mechanics.solver import SolveResult, SolverOptions, solve
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


def simulate(
    patient: PatientModel,
    plan: Plan,
    arm: str,
    settings: FemSettings,
    apart: float = 0.0,
    unilateral: bool = False,
    loads: Loads | None = None,
) -> SolveResult:
    """Displacement of every node under the plan; arm: one of `sliding.ARMS`; apart in mm and unilateral: as in
    boundary_conditions; loads: forces beside those of the elements."""
    boundary = boundary_conditions(patient, plan, arm, unilateral, apart)
    return solve(
        patient.points,
        patient.cells,
        settings.material(patient.tissue),
        replace(boundary, loads=loads),
        solver_options(settings),
    )


class PlanSolver:
    """Plans of one patient, for whom what is the same under every plan is made once; arm, apart: as in `simulate`.

    With settings.kept_factors by the factors of the stiffness at rest (:mod:`repeated`), and by Newton's method what
    they do not solve; without, and for lips in contact, one after the other by Newton's method, as in `simulate`.
    device: where bonded plans are solved with kept factors, "cuda" in whole batches (:mod:`batched`). preparation:
    seconds that the patient took.
    """

    def __init__(self, patient: PatientModel, arm: str, settings: FemSettings, apart: float = 0.0, device: str = "cpu"):
        self._patient, self._arm, self._settings, self._apart = patient, arm, settings, apart
        self._kept, began = None, time.perf_counter()
        if settings.kept_factors and arm != "mucosa+lip":
            boundary, law = self._boundary(Plan("rest", {})), settings.material(patient.tissue)
            known = patient.points, patient.cells, law, boundary, solver_options(settings)
            try:
                if device == "cpu" or boundary.sliding:
                    self._kept = RepeatedSolver(*known)
                else:
                    from pinnochio.mechanics.batched.solver import BatchSolver  # loads torch

                    self._kept = BatchSolver(*known, device)
            except RuntimeError as error:  # the stiffness at rest cannot be factorised
                logging.warning("no kept factors: %s", error)
        self.preparation = time.perf_counter() - began

    def solve(self, plans: Sequence[Plan]) -> list[SolveResult]:
        """Displacement of every node under each plan."""
        if self._kept is None:
            return [simulate(self._patient, plan, self._arm, self._settings, self._apart) for plan in plans]
        return self._kept.solve([self._boundary(plan) for plan in plans])

    def close(self) -> None:
        """Release the factors."""
        if self._kept is not None:
            self._kept.close()

    def _boundary(self, plan: Plan):
        return boundary_conditions(self._patient, plan, self._arm, apart=self._apart)


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
