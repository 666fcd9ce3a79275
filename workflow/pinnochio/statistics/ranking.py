"""Methods in the order of their mean error, each against the best over the same patients."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from pinnochio.seeds import derive_seed
from pinnochio.statistics.attainable import attainable
from pinnochio.statistics.wilcoxon import Comparison, compare, holm

LEVEL = 0.05


@dataclass(frozen=True)
class Ranking:
    """Methods from the best mean error to the worst, over the patients that all of them have.

    errors: one row per patient, one column per method in that order. against: each other method minus the best, with
    Holm's p. tested: whether so few patients can tell any two methods apart.
    """

    errors: pd.DataFrame
    against: dict[str, tuple[Comparison, float]]
    tested: bool

    @property
    def means(self) -> pd.Series:
        return self.errors.mean()

    @property
    def patients(self) -> int:
        return len(self.errors)

    @property
    def best(self) -> str:
        return self.errors.columns[0]

    @property
    def alike(self) -> list[str]:
        """Methods that are not told apart from the best."""
        return [name for name, (_, p) in self.against.items() if not p < LEVEL]


def rank(cases: pd.DataFrame, methods: Sequence[str], seed: int) -> Ranking:
    """Rank the methods by `cd` of CASES; bounds are not among them."""
    errors = cases.pivot(index="case", columns="method", values="cd")[list(methods)].dropna()
    order = errors.mean().sort_values(kind="stable").index
    best = order[0]
    tests = {
        name: compare(errors[name], errors[best], derive_seed(seed, "ranking", name)) for name in order if name != best
    }
    adjusted = holm([test.p for test in tests.values()])
    against = {name: (test, p) for (name, test), p in zip(tests.items(), adjusted, strict=True)}
    return Ranking(errors[order], against, attainable(len(errors), len(tests), LEVEL))
