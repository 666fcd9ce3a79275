"""The strain energy of the project and the constants of its tissues."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinnochio.errors import InputError

# Below this volume ratio ln J is replaced by its Taylor polynomial, so that nothing is singular. Small, because above
# it -mu ln J is the barrier that keeps elements at the bone from turning inside out; at 0.1 one head in 17 failed [X].
EXTENSION = 0.05


@dataclass(frozen=True)
class Material:
    """Constants per element, kPa: mu, lam and stiffening, each (m,).

    Psi = mu/2 (I1 - 3) + stiffening/2 (I1 - 3)^2 - mu ln J + lam/2 (ln J)^2, I1 = tr F'F; the law of the paper for
    stiffening 0 [S: PIN]. At small strain: isotropic elasticity with the Lame parameters mu and lam + 4 stiffening.
    """

    mu: np.ndarray
    lam: np.ndarray
    stiffening: np.ndarray
    extension: float = EXTENSION

    def __post_init__(self):
        for name in ("mu", "lam", "stiffening"):
            value = np.ascontiguousarray(getattr(self, name), float)
            least = 0.0 if name == "stiffening" else np.finfo(float).tiny
            if value.ndim != 1 or not np.isfinite(value).all() or (value.size and value.min() < least):
                raise InputError("-", "material", f"{name} must be finite, positive, one per element", "mend it")
            object.__setattr__(self, name, value)
        if not len(self.mu) == len(self.lam) == len(self.stiffening):
            raise InputError("-", "material", "mu, lam and stiffening differ in length", "give one per element")
        if not 0 < self.extension < 1:
            raise InputError("-", "material", f"extension is {self.extension}", "choose it in (0, 1)")


def lame(youngs_modulus, poisson) -> tuple:
    """Lame parameters (mu, lambda) in the unit of the modulus.

    >>> "%.3f %.2f" % lame(6.0, 0.49)
    '2.013 98.66'
    """
    mu = youngs_modulus / (2 * (1 + poisson))
    return mu, youngs_modulus * poisson / ((1 + poisson) * (1 - 2 * poisson))


def neo_hookean(
    tissue: np.ndarray,
    youngs_modulus: Mapping[int, float],
    poisson: float,
    stiffening: Mapping[int, float] | float = 0.0,
) -> Material:
    """Material of a mesh from the tissue code of each cell (m,) and the modulus in kPa of each code.

    `stiffening` in kPa, by code or one for all; 0 is the Neo-Hookean law.
    """
    if not 0 < poisson < 0.5:
        raise InputError("-", "material", f"Poisson's ratio is {poisson}", "choose it in (0, 0.5)")
    tissue = np.asarray(tissue)
    absent = sorted(set(np.unique(tissue).tolist()) - set(youngs_modulus))
    if absent:
        raise InputError("-", "material", f"tissue codes {absent} have no modulus", "give each code a modulus")
    modulus, extra = np.zeros(len(tissue)), np.zeros(len(tissue))
    for code, value in youngs_modulus.items():
        modulus[tissue == code] = value
        extra[tissue == code] = stiffening.get(code, 0.0) if isinstance(stiffening, Mapping) else stiffening
    return Material(*lame(modulus, poisson), extra)
