"""What the rules of the planner ask."""

from dataclasses import dataclass

from pinnochio.errors import InputError
from pinnochio.study.inputs.patients import NewPatientInputs
from pinnochio.study.study import Study


@dataclass(frozen=True)
class PlannerInputs:
    study: Study
    patients: NewPatientInputs

    def files(self, wildcards) -> list[str]:
        """What the planner needs of every new patient."""
        files = [f"{patient.folder}/planner.json" for patient in self.patients.named]
        if not self.study.choice.archive:
            problem = f"the planner shows the interval of a trained method, and {self.study.choice.method} has none"
            remedy = "leave predict.method as it is, or name a method of the archive"
            raise InputError("-", "configuration", problem, remedy)
        return files

    def settings(self, wildcards) -> dict:
        """What the planner needs to know of the patient and its models."""
        choice = self.study.choice
        return {
            "home": self.study.new_patients[wildcards.case].source,
            "archive": choice.folder,
            "method": choice.method,
            "corrections": choice.corrections,
            "fem": choice.settings["fem"],
            "invert": self.study.config["invert"],
            "scan": {
                "nasion_above_maxilla": self.study.config["interfaces"]["nasion_above_maxilla"],
                "limit": self.study.config["registration"]["limit"],
            },
        }
