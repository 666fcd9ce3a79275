"""What the rules of the report ask."""

from dataclasses import dataclass

from pinnochio.study.study import Study


@dataclass(frozen=True)
class ReportInputs:
    study: Study

    @property
    def shown(self) -> list[str]:
        """Patients in the report."""
        return self.study.cohort.scanned[: self.study.config["report"]["patients"]]

    @property
    def volumes(self) -> list[str]:
        """Networks whose volume the report shows: with and without physics, and the better one."""
        names = dict.fromkeys([*self.study.config["ablation"], self.study.config["better"]])
        return [name for name in names if name in self.study.methods.learned]
