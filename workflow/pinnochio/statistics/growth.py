"""How a cost grows with the size of a problem: a constant and a power of the size."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t

LEVEL = 0.95
STEEPEST = 6.0  # largest exponent that is looked for
STARTS = (0.5, 1.0, 1.5, 2.0)


@dataclass(frozen=True)
class Growth:
    """value(size) = constant + growing (size / largest)^exponent.

    growing: what grows, at the largest size; error: half the width of the 95 % interval of the exponent, NaN where the
    sizes are too few to tell or nothing grows. All NaN where nothing could be fitted.
    """

    points: int
    largest: float = np.nan
    constant: float = np.nan
    growing: float = np.nan
    exponent: float = np.nan
    error: float = np.nan

    def __call__(self, size):
        return self.constant + self.growing * (np.asarray(size, float) / self.largest) ** self.exponent

    @property
    def text(self) -> str:
        """The exponent with its interval; empty where there is none."""
        if np.isnan(self.exponent):
            return ""
        return f"{self.exponent:.2f}" + ("" if np.isnan(self.error) else f" ± {self.error:.2f}")


def fit(sizes: Sequence[float], values: Sequence[float], constant: bool = True) -> Growth:
    """Least squares on the logarithms, so that every size counts by its relative error; NaN values are left out.

    The constant is what does not grow, such as reading the label map: fitted with the rest, it bends no exponent. It is
    not negative; without `constant` it is zero. Needs as many sizes as it fits numbers.
    """
    sizes, values = np.asarray(sizes, float), np.asarray(values, float)
    known = np.isfinite(values) & (values > 0)
    sizes, values = sizes[known], values[known]
    if len(sizes) < 2 + constant:
        return Growth(len(sizes))
    largest, scale = sizes.max(), values.max()
    share, size = np.log(values / scale), np.log(sizes / largest)

    def misfit(x):  # x: exponent, logarithm of what grows, constant
        return np.log((x[2] if constant else 0.0) + np.exp(x[1] + x[0] * size)) - share

    free = 2 + constant
    low, high = [0.0, -20.0, 0.0], [STEEPEST, 1.0, np.exp(share.min())]
    starts = [[exponent, -0.7, 0.5 * high[2]] for exponent in STARTS]
    solution = min(
        (least_squares(misfit, s[:free], bounds=(low[:free], high[:free]), xtol=1e-12, ftol=1e-12) for s in starts),
        key=lambda result: result.cost,
    )
    rest = scale * solution.x[2] if constant else 0.0
    return Growth(len(sizes), largest, rest, scale * float(np.exp(solution.x[1])), solution.x[0], _error(solution))


def _error(solution) -> float:
    """Half-width of the 95 % interval of the first unknown, those at a bound fixed there."""
    loose = solution.active_mask == 0
    freedom = len(solution.fun) - int(loose.sum())
    if not loose[0] or freedom < 1:
        return np.nan
    jacobian = solution.jac[:, loose]
    if np.linalg.cond(jacobian) > 1e8:
        return np.nan
    covariance = np.linalg.inv(jacobian.T @ jacobian) * 2 * solution.cost / freedom
    return float(t.ppf(0.5 + LEVEL / 2, freedom) * np.sqrt(covariance[0, 0]))
