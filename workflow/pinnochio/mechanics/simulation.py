"""Finite-element simulation of a plan on a patient: what the FEM methods, the teacher and the tables share."""

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.mechanics.solver import SolveResult, SolverOptions, solve


def solver_options(settings: FemSettings) -> SolverOptions:
    """The solver's part of the settings."""
    return SolverOptions(
        volumetric=settings.volumetric,
        increments=settings.increments,
        tolerance=settings.tolerance,
        max_iterations=settings.max_iterations,
        time_limit=settings.time_limit,
        linear_solver=settings.linear_solver,
    )


def simulate(patient: PatientModel, plan: Plan, arm: str, settings: FemSettings, apart: float = 0.0) -> SolveResult:
    """Displacement of every node under the plan; arm: one of `sliding.ARMS`; apart in mm: as in boundary_conditions."""
    return solve(
        patient.points,
        patient.cells,
        settings.material(patient.tissue),
        boundary_conditions(patient, plan, arm, apart=apart),
        solver_options(settings),
    )
