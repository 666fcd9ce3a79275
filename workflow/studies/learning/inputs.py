"""What the learning curve reads: the first folds again, each on a part of its training patients."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from pinnochio.errors import InputError
from pinnochio.methods.names import BASELINE, FLOOR
from pinnochio.study.folds import of_fewer

METRICS = "<results>/folds/{}/{}/metrics.csv"


@dataclass(frozen=True)
class Learning:
    """section: of the configuration; training: patients that each fold trains on; methods: of the study."""

    section: Mapping
    training: Mapping[str, int]
    methods: Sequence[str]

    @cached_property
    def folds(self) -> dict[int, list[str]]:
        """Folds by the number of training patients, smallest first; last those of the study, which train on all."""
        first = list(self.training)[: self.section["folds"]]
        most = min((self.training[fold] for fold in first), default=0)
        sizes = [size for size in sorted(self.section["patients"]) if size < most]
        return {size: [of_fewer(fold, size) for fold in first] for size in sizes} | {most: first}

    @property
    def untaught(self) -> list[str]:
        """What the curve is seen against: the noise floor where it is known, and finite elements."""
        return [name for name in (FLOOR, BASELINE) if name in self.methods]

    def metrics(self, wildcards) -> dict[str, list[str]]:
        """Metrics of what is not trained, then of each method, number by number; InputError where some cannot be."""
        if BASELINE not in self.methods:
            problem = f"the learning curve is seen against {BASELINE!r}"
            raise InputError("-", "configuration", problem, "add it to 'methods'")
        *_, whole = self.folds.values()
        parts = [fold for folds in self.folds.values() for fold in folds]
        return {
            "untrained": [METRICS.format(fold, name) for name in self.untaught for fold in whole],
            "trained": [METRICS.format(fold, name) for name in self.section["methods"] for fold in parts],
        }
