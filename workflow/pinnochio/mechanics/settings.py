"""The plain values of a finite-element model, apart from what solves it, which takes long to load."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinnochio.mechanics.elements.materials import Material, neo_hookean
from pinnochio.model.labels import TISSUES

EXACT = "exact"


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """How an equilibrium is looked for.

    increments: the first load increment is 1/increments; it shrinks on failure and grows by `growth` on success.

    tolerance: residual on the free nodes over the reaction on the constrained ones, at the end of the load;
    loose: the same at intermediate loads, which only have to be good starts.
    max_iterations: Newton iterations per increment; max_systems: linear systems in all, which ends a solve on every
    machine at the same place. time_limit in s. min_increment: share of the load.
    restart: begin again from rest if the start leads nowhere, or at once if more than a quarter of its elements are
    inverted; else its last iterate is the result.
    reuse: solve by conjugate gradients on factors in single precision, of an earlier tangent where that costs less than
    new factors; else every system is factorised in double precision.
    accuracy: mm from the equilibrium at every point of the judged face at which a plan by kept factors is near enough,
    or EXACT: the tolerance decides.
    yielding: the volume ratio below which squeezed tissue hardly resists any more, 0 for tissue that bears any
    pressure. Only the simulated outcome has it.
    """

    volumetric: str
    increments: int
    tolerance: float
    max_iterations: int
    max_systems: int
    linear_solver: str
    time_limit: float = np.inf
    growth: float = 2.0
    loose: float = 1e-2
    min_increment: float = 1 / 256
    restart: bool = True
    reuse: bool = True
    yielding: float = 0.0
    accuracy: float | str = EXACT

    @property
    def barrier(self) -> bool:
        """Whether no step turns an element inside out; elements that the material lets yield may be so at the end."""
        return not self.yielding


@dataclass(frozen=True, kw_only=True)
class FemSettings(SolverSettings):
    """The section `fem` of the configuration; youngs_modulus in kPa by tissue name.

    stiffening: second term of the material in kPa, of the simulated outcome alone. kept_factors: plans are solved by
    `simulation.Simulator` on the factors of the stiffness at rest.
    """

    youngs_modulus: Mapping[str, float]
    poisson: float
    stiffening: float = 0.0
    kept_factors: bool = False

    def material(self, tissue: np.ndarray) -> Material:
        """Material of each element of a mesh with `tissue` codes (m,)."""
        moduli = {TISSUES[name]: modulus for name, modulus in self.youngs_modulus.items()}
        law = neo_hookean(tissue, moduli, self.poisson, self.stiffening)
        return replace(law, extension=self.yielding) if self.yielding else law
