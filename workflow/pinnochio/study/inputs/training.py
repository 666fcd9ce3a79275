"""What the rules of training ask: the patients of a fold that it does not hold out, and settings of the method."""

from collections.abc import Callable
from dataclasses import dataclass

from pinnochio.study.inputs.gathered import GatheredInputs
from pinnochio.study.study import Study
from pinnochio.training.settings import PATIENTS_IN_MEMORY


@dataclass(frozen=True)
class TrainingInputs:
    study: Study

    def cases(self, wildcards) -> list[str]:
        return self.study.folds.training(wildcards.fold)

    def gathered(self, kind: str) -> Callable:
        """Input function: where files of a kind lie of the patients that the job's fold trains on; nowhere for a method
        that reads none."""
        gathered, methods = GatheredInputs(self.study), self.study.methods

        def folders(wildcards) -> list[str]:
            method = methods[wildcards.method]
            unread = (kind == "lift" and method.lift == "none") or (kind == "covariates" and not method.covariates)
            return [] if unread else gathered.training(wildcards.fold, kind)

        return folders

    def pretrained(self, wildcards) -> str | list:
        """The network that finite-element fields have pretrained, where the method has such a phase."""
        pretrains = "pretraining" in self.study.methods[wildcards.method].settings
        return f"<results>/folds/{wildcards.fold}/{wildcards.method}/pretrained.pt" if pretrains else []

    def learner(self, wildcards) -> str:
        """Reference of the learner, or of the function `fit`, of the job's method."""
        return self.study.methods[wildcards.method].learner

    def settings(self, *names: str) -> Callable:
        """Params function: of the settings of the job's method those of the names."""
        return lambda wildcards: {
            name: value for name, value in self.study.methods[wildcards.method].settings.items() if name in names
        }

    @property
    def histories(self) -> list[str]:
        """The loss histories of the study's networks: of each method, phase by phase, fold by fold."""
        return [
            f"<results>/folds/{fold}/{method}/{phase}.csv"
            for method in self.study.methods.learned
            for phase, settings in self.study.methods.phases(method).items()
            if settings
            for fold in self.study.folds.held_out
        ]

    def memory(self, wildcards) -> int:
        """MB that a training takes: its process, and 40 for each patient that it holds at once."""
        phases = self.study.methods.phases(wildcards.method).values()
        held = max((phase.get("patients_in_memory", PATIENTS_IN_MEMORY) for phase in phases if phase), default=0)
        return 4000 + 40 * min(held, len(self.cases(wildcards)))
