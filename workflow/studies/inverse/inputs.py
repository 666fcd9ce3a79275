"""What the rules from a wished face to a plan ask."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.study.inputs.patients import NewPatientInputs
from pinnochio.study.study import Study


def check_bounds(bounds: Mapping[str, Mapping]) -> None:
    """InputError where bounds of a bone shut out the place where it is."""
    for kind, intervals in bounds.items():
        if shut := [name for name, (low, high) in intervals.items() if not low <= 0 <= high]:
            problem = f"invert.bounds.{kind}.{shut[0]} is {intervals[shut[0]]}, which shuts out the bone where it is"
            remedy = "let it reach from 0 or less to 0 or more: a proposal begins with nothing moved"
            raise InputError("-", "configuration", problem, remedy)


@dataclass(frozen=True)
class WishInputs:
    study: Study
    patients: NewPatientInputs

    def files(self, wildcards) -> list[str]:
        """The files that say how the patient's face shall be."""
        return list(self.study.new_patients[wildcards.case].wishes)

    def occlusion(self, wildcards) -> list[str]:
        """The plan of a new patient whose relation of the jaws every proposal keeps, if there is one."""
        name = self.study.config["invert"]["occlusion"]
        if name in ("free", "rest"):
            return []
        patient = self.study.new_patients[wildcards.case]
        if name not in patient.plans:
            known = ", ".join(patient.plans) or "none"
            problem = f"invert.occlusion names the plan {name!r}, and the patient's plans are: {known}"
            remedy = "name one of them, or 'rest' for the occlusion as it is, or 'free'"
            raise InputError(wildcards.case, "configuration", problem, remedy)
        return [f"{patient.folder}/{name}/plan.json"]

    def calibration(self, wildcards) -> list[str]:
        """The calibration of the intervals of finite elements: a plain file of the archive or the study, if there."""
        folders = [folder for folder in (self.study.choice.folder, f"{self.study.results}/methods") if folder]
        files = [Path(folder, "fem_sliding", "calibration.json").resolve() for folder in folders]
        return [str(file) for file in files if file.is_file()][:1]

    def proposals(self, wildcards) -> list[str]:
        """What is handed over of every new patient of whom a face is wished."""
        wished = [patient.folder for patient in self.patients.named if patient.wishes]
        if not wished:
            remedy = "add wish.mrk.json, .fcsv, .csv or .ply"
            raise InputError("-", self.study.config["patient"], "nobody's face is wished otherwise", remedy)
        return [f"{folder}/invert/index.html" for folder in wished]
