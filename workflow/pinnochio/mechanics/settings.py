"""The plain values of a finite-element model, apart from what solves it, which takes long to load."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinnochio.mechanics.elements.materials import Material, neo_hookean
from pinnochio.model.labels import TISSUES


@dataclass(frozen=True)
class FemSettings:
    """The section `fem` of the configuration; youngs_modulus in kPa by tissue name, time_limit in s;
    increments to linear_solver: as in :class:`pinnochio.mechanics.solvers.newton.SolverOptions`.

    The simulated outcome alone has stiffening, second term of the material in kPa, and yielding: the volume ratio below
    which squeezed tissue hardly resists any more, 0 for tissue that bears any pressure. kept_factors: solve plans
    by `simulation.PlanSolver` on the factors of the stiffness at rest.
    """

    youngs_modulus: Mapping[str, float]
    poisson: float
    volumetric: str
    increments: int
    tolerance: float
    max_iterations: int
    max_systems: int
    linear_solver: str
    time_limit: float = np.inf
    stiffening: float = 0.0
    yielding: float = 0.0
    kept_factors: bool = False

    def material(self, tissue: np.ndarray) -> Material:
        """Material of each element of a mesh with `tissue` codes (m,)."""
        moduli = {TISSUES[name]: modulus for name, modulus in self.youngs_modulus.items()}
        law = neo_hookean(tissue, moduli, self.poisson, self.stiffening)
        return replace(law, extension=self.yielding) if self.yielding else law
