"""The plain values of a finite-element model, apart from what solves it, which takes long to load."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinnochio.mechanics.materials import Material, neo_hookean
from pinnochio.model.labels import TISSUES


@dataclass(frozen=True)
class FemSettings:
    """The section `fem` of the configuration; youngs_modulus in kPa by tissue name, time_limit in s.

    stiffening: second term of the material in kPa, which the simulated outcome alone has.
    """

    youngs_modulus: Mapping[str, float]
    poisson: float
    volumetric: str
    increments: int
    tolerance: float
    max_iterations: int
    time_limit: float
    linear_solver: str
    stiffening: float = 0.0

    def material(self, tissue: np.ndarray) -> Material:
        """Material of each element of a mesh with `tissue` codes (m,)."""
        moduli = {TISSUES[name]: modulus for name, modulus in self.youngs_modulus.items()}
        return neo_hookean(tissue, moduli, self.poisson, self.stiffening)
