"""The input functions of all rule files, for the workflow."""

from dataclasses import dataclass
from functools import cached_property

from pinnochio.study.inputs.cohort import CohortInputs
from pinnochio.study.inputs.patient import PatientInputs
from pinnochio.study.inputs.patients import NewPatientInputs
from pinnochio.study.inputs.prediction import PredictionInputs
from pinnochio.study.inputs.report import ReportInputs
from pinnochio.study.inputs.tables import TableInputs
from pinnochio.study.inputs.training import TrainingInputs
from pinnochio.study.study import Study


@dataclass(frozen=True)
class RuleInputs:
    """By the rule file that asks them."""

    study: Study

    @cached_property
    def cohort(self) -> CohortInputs:
        return CohortInputs(self.study)

    @cached_property
    def patient(self) -> PatientInputs:
        return PatientInputs(self.study)

    @cached_property
    def training(self) -> TrainingInputs:
        return TrainingInputs(self.study)

    @cached_property
    def prediction(self) -> PredictionInputs:
        return PredictionInputs(self.study)

    @cached_property
    def tables(self) -> TableInputs:
        return TableInputs(self.study)

    @cached_property
    def patients(self) -> NewPatientInputs:
        return NewPatientInputs(self.study)

    @cached_property
    def report(self) -> ReportInputs:
        return ReportInputs(self.study)
