"""The input functions of all rule files, for the workflow."""

from pinnochio.study.inputs.cohort import CohortInputs
from pinnochio.study.inputs.gathered import GatheredInputs
from pinnochio.study.inputs.patient import PatientInputs
from pinnochio.study.inputs.patients import NewPatientInputs
from pinnochio.study.inputs.prediction import PredictionInputs
from pinnochio.study.inputs.report import ReportInputs
from pinnochio.study.inputs.tables import TableInputs
from pinnochio.study.inputs.training import TrainingInputs
from pinnochio.study.study import Study


class RuleInputs:
    """By the rule file that asks them."""

    def __init__(self, study: Study):
        self.cohort, self.patient, self.training = CohortInputs(study), PatientInputs(study), TrainingInputs(study)
        self.prediction, self.tables = PredictionInputs(study), TableInputs(study)
        self.gathered, self.patients, self.report = GatheredInputs(study), NewPatientInputs(study), ReportInputs(study)
