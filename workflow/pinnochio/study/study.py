"""One study as its workflow asks for it: cohort, folds, methods, new patients and the files of each."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from pinnochio.code import ROOT
from pinnochio.errors import InputError
from pinnochio.files import NAME
from pinnochio.manifest import MANIFEST
from pinnochio.study.choice import Choice, choose
from pinnochio.study.cohort import Cohort, read_cohort
from pinnochio.study.folds import Folds
from pinnochio.study.methods import Methods
from pinnochio.study.patients import Patient, of_study, read_patients

SHIPPED = ROOT / "models"  # an archive that comes with the project


@dataclass(frozen=True)
class Study:
    """What a configuration, its cohort and the new patients that it names decide.

    Patterns begin with <results>/, which Snakemake fills in. What a rule file alone asks stands in `inputs`.
    """

    config: Mapping
    results: str
    cohort: Cohort

    @classmethod
    def of(cls, config: Mapping) -> "Study":
        """The study of a configuration; InputError for a cohort table that is none."""
        results = config["pathvars"]["results"]
        return cls(config, results, read_cohort(config, results))

    @cached_property
    def folds(self) -> Folds:
        return Folds.drawn(self.cohort, self.config["folds"], self.config["seed"])

    @cached_property
    def methods(self) -> Methods:
        return Methods(self.config, self.cohort, self.folds)

    @cached_property
    def new_patients(self) -> dict[str, Patient]:
        """The new patients that the configuration names."""
        return read_patients(self.config["patient"]) if self.config["patient"] else {}

    @cached_property
    def choice(self) -> Choice | None:
        """What predicts the new patients: read from the archive that the configuration names, for them alone."""
        if not self.new_patients:
            return None
        return choose(self.config, self.models)

    @property
    def models(self) -> str:
        """The archive that predicts new patients: the one that is named, else the study's, else the project's own."""
        packed = f"{self.results}/archive"
        shipped = (SHIPPED / MANIFEST).is_file() and not Path(packed, MANIFEST).is_file()
        return self.config["models"] or (str(SHIPPED) if shipped else packed)

    def patient(self, wildcards) -> Patient:
        """The patient of a job, by home and case."""
        homes = {"cases": self.case, "patients": self.new_patient}
        return homes[getattr(wildcards, "home", "cases")](wildcards.case)

    def case(self, name: str) -> Patient:
        """The patient of the study."""
        if name not in self._cases:
            self._cases[name] = of_study(self._known(name, self.cohort.cases, self.cohort.name), self.config)
        return self._cases[name]

    @cached_property
    def _cases(self) -> dict[str, Patient]:
        """Those that have been asked for."""
        return {}

    def _known(self, name: str, among: Mapping, whose: str):
        if name not in among:
            raise InputError(name, whose, "it has no patient of this name", "name one of its patients")
        return among[name]

    def new_patient(self, name: str) -> Patient:
        """The new patient, made with the settings that its models were trained with."""
        self._known(name, self.new_patients, self.config["patient"] or "the configuration")
        config = {**self.config, **self.choice.settings}
        return replace(self.new_patients[name], config=config, choice=self.choice)

    # Files of the study's patients.

    def motion_of(self, case: str) -> str:
        """The file of the motion that predictions of the study's patient take, and training with it: the achieved one
        where it is known and the configuration does not ask for the plan."""
        known = self.cohort.cases[case].postop_bones and self.config["motion"] == "achieved"
        return f"<results>/cases/{case}/{'achieved' if known else 'plan'}.json"

    @cached_property
    def both_motions(self) -> list[str]:
        """Patients with a scan that are predicted from the achieved motion and from the plan."""
        return [name for name in self.cohort.scanned if not self.motion_of(name).endswith("/plan.json")]

    @cached_property
    def planned(self) -> list[str]:
        """Methods that are also predicted from the plan; those made elsewhere predict once."""
        without = self.config["planned"]["without"]
        names = [name for name in self.methods.compared if self.methods[name].predictor and name not in without]
        return names if self.both_motions else []

    def model_of(self, case: str, method: str, file: str = "model.h5") -> str:
        """The model of the study's patient that the method predicts on, or another file of the same mesh."""
        return f"<results>/cases/{case}{'/lips' if self.methods[method].mesh == 'lips' else ''}/{file}"

    def sized(self, nodes: int, file: str) -> str:
        """A file of the patient on the mesh of so many nodes."""
        folder = "" if nodes == self.config["mesh"]["nodes"] else f"/nodes_{nodes}"
        return f"<results>/cases/{{case}}{folder}/{file}"

    @property
    def wildcards(self) -> dict[str, str]:
        """What each wildcard of the rules may be; where there is nothing, a name that nothing bears.

        `home` is the folder of imported patients below the results, cases of the study or patients that are new, and
        `case` any name: whether there is such a patient is looked up, because ten thousand names search slowly; `mesh`
        is empty or /nodes_N; `plan` is empty for the study's own plan, /NAME for one of a new patient; `fold` may train
        on fewer patients, 1of8; `batch` is what is predicted in one job: folds/N or planned/N (the same patients from
        their plans).
        """
        plans = "|".join(sorted({plan for patient in self.new_patients.values() for plan in patient.plans})) or "none"
        folds = rf"(?:{'|'.join(self.folds.held_out)})(?:of\d+)?"
        return {
            "home": "cases|patients",
            "case": NAME.pattern,
            "mesh": r"|/nodes_\d+",
            "plan": f"|/(?:{plans})",
            "fold": folds,
            "batch": f"(?:folds|planned)/{folds}",
            "nodes": r"\d+",
            "method": "|".join([*self.methods.registry, self.config["predict"]["method"]]),
        }


def filled(pattern: str, cases: Iterable[str]) -> list[str]:
    """The pattern for each case."""
    return [pattern.replace("{case}", case) for case in cases]
