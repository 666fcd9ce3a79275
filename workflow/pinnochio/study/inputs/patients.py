"""What the rules of new patients ask, and of the archive that predicts them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from pinnochio.code import code_hash, source_file
from pinnochio.errors import InputError
from pinnochio.patients.model_archive import FALLBACK, configuration_hash
from pinnochio.study.patients import Patient
from pinnochio.study.provenance import PLACES
from pinnochio.study.study import Study


@dataclass(frozen=True)
class NewPatientInputs:
    study: Study

    @cached_property
    def packed(self) -> list[str]:
        """What is packed for new patients: every method with an interval, and the one that shall predict them."""
        config, methods = self.study.config, self.study.methods
        names = dict.fromkeys([*config["uncertainty"]["methods"], config["predict"]["method"]])
        return [name for name in names if name in methods.of_family("graph network") and name in methods.learned]

    @cached_property
    def predicts(self) -> str:
        """Hash of the code that predicts a new patient, for archive and certificate."""
        stages = ("patient.import_segmentation", "patient.label_interfaces", "prediction.predict")
        return code_hash(*(source_file(f"scripts.{name}") for name in stages))

    @property
    def packed_intervals(self) -> list[str]:
        """Methods whose calibration is packed: those above, and finite elements, which stand in and answer wishes."""
        return [*self.packed, *(name for name in self.study.methods.calibrated if name == FALLBACK)]

    @property
    def configuration(self) -> str:
        """Hash of what decides about the models, not of where files lie and who is predicted."""
        return configuration_hash({name: value for name, value in self.study.config.items() if name not in PLACES})

    def archive(self, wildcards) -> list[str]:
        """The archive of the study, where it trains what is to be packed."""
        if not self.packed:
            problem = "no method of uncertainty.methods and predict.method is trained here"
            remedy = "add one to 'methods', with a scan of at least one patient per fold"
            raise InputError("-", "configuration", problem, remedy)
        return ["<results>/archive/archive.json"]

    @property
    def named(self) -> list[Patient]:
        """The new patients; InputError where none is named."""
        if not self.study.new_patients:
            raise InputError("-", "configuration", "no new patient is named", "add --config patient=FOLDER")
        return list(self.study.new_patients.values())

    def plans(self, wildcards) -> list[str]:
        """The checked plans of a new patient."""
        patient = self.study.new_patients[wildcards.case]
        return [f"{patient.folder}/{plan}/plan.json" for plan in patient.plans]

    @property
    def fields(self) -> dict[str, str]:
        """What holds the prediction of a new patient: one result, or that of networks with what it is made of."""
        names = {"result": "predictions.h5"}
        if not self.study.choice or self.study.choice.archive:
            names = {"result": "interval.h5", "ensemble": "ensemble.h5"}
        return {key: f"<results>/{{home}}/{{case}}{{plan}}/{{method}}/{name}" for key, name in names.items()}

    def results(self, wildcards) -> list[str]:
        """The files that hold a new patient's displacement by plan, with the interval of a learned method."""
        return self.of_plans("interval.h5" if self.study.choice.archive else "predictions.h5")(wildcards)

    def of_plans(self, name: str) -> Callable:
        """Input function: a file of every plan of a new patient."""

        def files(wildcards) -> list[str]:
            patient = self.study.new_patients[wildcards.case]
            return [f"{patient.folder}/{plan}/{wildcards.method}/{name}" for plan in patient.plans]

        return files

    def predictions(self, wildcards) -> list[str]:
        """What is handed over of every new patient and plan."""
        patients, method = self.named, self.study.choice.method
        for patient in patients:
            if not patient.plans:
                remedy = "add plan.json, or plans/NAME.json for several, or make one with the planner (make planner)"
                raise InputError(patient.name, patient.source, "there is no plan", remedy)
        return [
            f"{patient.folder}/{plan}/{method}/{name}"
            for patient in patients
            for plan in patient.plans
            for name in ("certificate.json", "index.html", "deformed.vtu")
        ] + [
            f"{patient.folder}/{name}"
            for patient in patients
            for name in ["segments.png", "quality.png", *([f"plans_{method}.html"] if len(patient.plans) > 1 else [])]
        ]
