"""The plain values of a finite-element model, apart from what solves it, which takes long to load."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinnochio.mechanics.elements import VOLUMETRIC
from pinnochio.mechanics.materials import Material, neo_hookean
from pinnochio.model.labels import TISSUES


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
