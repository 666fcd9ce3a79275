"""What the rules of evaluation and tables ask."""

from dataclasses import dataclass

from pinnochio.methods.names import few
from pinnochio.statistics.attainable import attainable
from pinnochio.study.study import Study

PICTURED = 6  # methods side by side in a picture


@dataclass(frozen=True)
class TableInputs:
    study: Study

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
