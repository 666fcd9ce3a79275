"""Finite-element simulation of a plan on a patient: what the FEM methods, the pretraining and the tables share."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.loads import Loads
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
        time_limit=settings.time_limit,
        linear_solver=settings.linear_solver,
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
