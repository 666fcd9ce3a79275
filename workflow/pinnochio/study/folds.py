"""The folds that hold cases out: who is held out, who trains, who is judged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from pinnochio.seeds import generator
from pinnochio.study.cohort import Cohort


@dataclass(frozen=True)
class Folds:
    """held_out: patients of each whole fold. Folds of fewer training patients are named by :func:`of_fewer`."""

    cohort: Cohort
    held_out: Mapping[str, list[str]]
    seed: int

    @classmethod
    def drawn(cls, cohort: Cohort, folds: int, seed: int) -> "Folds":
        return cls(cohort, assign_folds(cohort.scanned, cohort.unscanned, folds, seed), seed)

    @property
    def first(self) -> str:
        return next(iter(self.held_out))

    @cached_property
    def by_case(self) -> dict[str, str]:
        """The fold that holds each case out."""
        return {case: fold for fold, cases in self.held_out.items() for case in cases}

    def kept_from(self, fold: str) -> list[str]:
        """Patients that the fold, whole or of fewer training patients, holds out."""
        return self.held_out[whole_fold(fold)[0]]

    @cached_property
    def _training(self) -> dict[str, list[str]]:
        """Training patients of the folds that have been drawn."""
        return {}

    def training(self, fold: str) -> list[str]:
        """Patients that the fold trains on."""
        if fold not in self._training:
            (whole, patients), kept = whole_fold(fold), set(self.kept_from(fold))
            names = [name for name in self.cohort.scanned if name not in kept]
            self._training[fold] = names if patients is None else some(names, patients, self.seed, whole)
        return self._training[fold]

    def judged(self, fold: str) -> list[str]:
        """Held-out patients of the fold that have a scan."""
        return [name for name in self.kept_from(fold) if self.cohort.cases[name].postop]


def assign_folds(scanned: Sequence[str], unscanned: Sequence[str], folds: int, seed: int) -> dict[str, list[str]]:
    """Held-out cases of each fold ("1", "2", ...), drawn once from the seed; fold sizes differ by at most one.

    The patients without a post-operative scan are dealt after the scanned ones, whose folds they leave as they are.
    """
    held_out: dict[str, list[str]] = {str(fold + 1): [] for fold in range(folds)}
    shuffled = [
        group[i]
        for group in (scanned, unscanned)
        for i in generator(seed, "folds", ",".join(group)).permutation(len(group))
    ]
    for number, name in enumerate(shuffled):
        held_out[str(number % folds + 1)].append(name)
    return {fold: sorted(cases) for fold, cases in held_out.items() if cases}


def of_fewer(fold: str, patients: int) -> str:
    """What the fold is called that holds out the same cases and trains on so many patients only."""
    return f"{fold}of{patients}"


def whole_fold(fold: str) -> tuple[str, int | None]:
    """The fold that holds the same cases out, and how many patients it trains on; None for all."""
    whole, _, patients = fold.partition("of")
    return whole, int(patients) if patients else None


def some(names: Sequence[str], patients: int, seed: int, fold: str) -> list[str]:
    """So many of the names, in their order: drawn so that fewer are among more."""
    drawn = generator(seed, "learning", fold).permutation(len(names))[:patients]
    return [names[i] for i in sorted(drawn)]
