"""Finite-element simulation of a plan on a patient: what the FEM methods, the teacher and the tables share."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinnochio.anatomy.labels import TISSUES
from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.mechanics.elements import VOLUMETRIC
from pinnochio.mechanics.materials import Material, neo_hookean
from pinnochio.mechanics.sliding import boundary_conditions
from pinnochio.mechanics.solver import SolveResult, SolverOptions, solve


@dataclass(frozen=True)
class FemSettings:
    """The finite-element model: youngs_modulus in kPa by tissue name, poisson, element and solver settings."""

    youngs_modulus: Mapping[str, float]
    poisson: float
    volumetric: str = VOLUMETRIC[0]
    increments: int = 2
    tolerance: float = 1e-6
    max_iterations: int = 30
    time_limit: float = 50.0
    linear_solver: str = "auto"
    stiffening: float = 0.0

    def material(self, tissue: np.ndarray) -> Material:
        """Material of each element of a mesh with `tissue` codes (m,)."""
        moduli = {TISSUES[name]: modulus for name, modulus in self.youngs_modulus.items()}
        return neo_hookean(tissue, moduli, self.poisson, self.stiffening)

    def options(self) -> SolverOptions:
        """The solver's part of the settings."""
        return SolverOptions(
            volumetric=self.volumetric,
            increments=self.increments,
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
            time_limit=self.time_limit,
            linear_solver=self.linear_solver,
        )


def simulate(patient: PatientModel, plan: Plan, arm: str, settings: FemSettings, apart: float = 0.0) -> SolveResult:
    """Displacement of every node under the plan; arm: one of `sliding.ARMS`; apart in mm: as in boundary_conditions."""
    return solve(
        patient.points,
        patient.cells,
        settings.material(patient.tissue),
        boundary_conditions(patient, plan, arm, apart=apart),
        settings.options(),
    )
