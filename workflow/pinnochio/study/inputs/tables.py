"""What the rules of evaluation and tables ask."""

from collections.abc import Callable
from dataclasses import dataclass

from pinnochio.methods.names import few
from pinnochio.statistics.attainable import attainable
from pinnochio.study.study import Study, filled

PICTURED = 6  # methods side by side in a picture


@dataclass(frozen=True)
class TableInputs:
    study: Study

    def judged(self, wildcards) -> list[str]:
        return self.study.folds.judged(wildcards.fold)

    def of_judged(self, pattern: str) -> Callable:
        """`pattern` for each held-out case of the fold that can be judged."""
        return lambda wildcards: filled(pattern, self.judged(wildcards))

    def models(self, wildcards) -> list[str]:
        """The models that the method predicts the held-out cases of the fold on."""
        return self._of_models(wildcards, "model.h5")

    def truths(self, wildcards) -> list[str]:
        """The true motions at the points of these models, where they are known."""
        return self._of_models(wildcards, "true_motion.h5") if self.study.cohort.virtual else []

    def _of_models(self, wildcards, file: str) -> list[str]:
        cases = self.study.folds.kept_from(wildcards.fold)
        return [self.study.model_of(case, wildcards.method, file) for case in cases]

    def motions(self, wildcards) -> list[str]:
        """The motions that the method predicts the held-out cases of the fold with."""
        cases = self.study.folds.kept_from(wildcards.fold)
        return [self.study.motion_of(case, wildcards.method, wildcards.arm) for case in cases]

    @property
    def pictured(self) -> list[str]:
        """Methods that the picture of a patient shows."""
        return few(self.study.methods.compared, PICTURED)

    @property
    def better(self) -> bool:
        """Whether the better network is there to be compared with, by patients enough for a test to say something."""
        methods, patients = self.study.methods, len(self.study.cohort.scanned)
        return self.study.config["better"] in methods.used and attainable(patients, len(methods.compared) - 1)

    @property
    def ablated(self) -> bool:
        """Whether the ablation has all of its variants."""
        names = self.study.config["ablation"]
        return bool(self.study.cohort.scanned and names) and set(names) <= set(self.study.methods.learned)

    @property
    def measured(self) -> list[str]:
        """Tables of what is measured of the methods."""
        cohort = self.study.cohort
        return [
            "cases",
            *(["accuracy", "regions"] if cohort.scanned else []),
            *(["better"] if self.better else []),
            *(["planned"] if self.study.planned else []),
            *(["landmarks"] if cohort.scanned and cohort.virtual else []),
            *(["ablation"] if self.ablated else []),
            *(["claims"] if cohort.scanned and "pinnochio" in self.study.methods.used else []),
            *(["segments"] if cohort.registered else []),
        ]

    @property
    def costs(self) -> list[str]:
        """Tables of what the study costs."""
        return ["stages", *(["training"] if self.study.methods.learned else [])]
