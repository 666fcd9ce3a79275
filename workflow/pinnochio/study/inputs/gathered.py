"""What the rules ask that gather the held-out patients of a fold, and those that read what is gathered."""

from dataclasses import dataclass

from pinnochio.gathered import gathered_name
from pinnochio.importing.cohort import Case
from pinnochio.study.folds import whole_fold
from pinnochio.study.study import Study

KINDS = {
    "imported": ("import.json", "plan.json", "postop.h5", "achieved.json"),
    "model": ("model.h5",),
    "lift": ("lift_elastic.h5",),
    "samples": ("fem_samples.h5",),
    "scan": ("plan.json", "motion.json", "postop.h5"),
    "covariates": ("covariates.json",),
    "judged": ("judged.h5", "true_motion.h5"),
    "lips": ("lips/model.h5", "lips/true_motion.h5"),
}
# What a patient has that was scanned.
AFTER = dict.fromkeys(("fem_samples.h5", "postop.h5", "judged.h5"), "postop") | {"achieved.json": "postop_bones"}


@dataclass(frozen=True)
class GatheredInputs:
    study: Study

    def held_out(self, fold: str, kind: str) -> list[str]:
        """Where files of a kind lie of the patients that the fold holds out."""
        return [f"<results>/held_out/{whole_fold(fold)[0]}/{kind}"]

    def training(self, fold: str, kind: str) -> list[str]:
        """Where they lie of the patients that it trains on."""
        folds = self.study.folds
        others = [other for other in folds.held_out if other != whole_fold(fold)[0] and folds.judged(other)]
        return [folder for other in others for folder in self.held_out(other, kind)]

    @property
    def imported(self) -> list[str]:
        """Where all lie that say that what is brought of a patient could be read."""
        return [folder for fold in self.study.folds.held_out for folder in self.held_out(fold, "imported")]

    def files(self, wildcards) -> list[str]:
        """The files of the kind of the patients that the job's fold holds out."""
        return list(self._named(wildcards).values())

    def names(self, wildcards) -> list[str]:
        """What each of them is called there."""
        return list(self._named(wildcards))

    def _named(self, wildcards) -> dict[str, str]:
        return {
            gathered_name(case, name): (
                self.study.motion_of(case) if name == "motion.json" else f"<results>/cases/{case}/{name}"
            )
            for case in self.study.folds.held_out[wildcards.fold]
            for name in KINDS[wildcards.kind]
            if self._is_there(self.study.cohort.cases[case], name, wildcards.kind)
        }

    def _is_there(self, case: Case, name: str, kind: str) -> bool:
        virtual, scan = self.study.cohort.virtual, AFTER.get(name)
        if name.endswith("true_motion.h5"):
            return virtual
        # Of a virtual patient no outcome is waited for.
        return not scan or bool(getattr(case, scan)) and not (virtual and kind == "imported")
