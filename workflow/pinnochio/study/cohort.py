"""The cohort of a study: the patients of a table, or virtual ones."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pinnochio.importing.cohort import Case, read_cases
from pinnochio.virtual.case_files import LOCKED


@dataclass(frozen=True)
class Cohort:
    """name: what tables call it; cases: by the patient's name; locked: whether its outcomes are kept apart."""

    name: str
    cases: Mapping[str, Case]
    virtual: bool = False
    locked: bool = False

    @cached_property
    def scanned(self) -> list[str]:
        """Patients with a post-operative scan; every patient is predicted, but only these train and judge."""
        return [name for name, case in self.cases.items() if case.postop]

    @cached_property
    def unscanned(self) -> list[str]:
        return [name for name, case in self.cases.items() if not case.postop]

    @cached_property
    def registered(self) -> list[str]:
        """Patients whose segments are registered on post-operative bones: their achieved motion is known."""
        return [name for name, case in self.cases.items() if case.postop_bones]

    @property
    def described(self) -> list[str]:
        """Patients of whom covariates are known."""
        return [name for name, case in self.cases.items() if case.covariates or case.covariates_file]


def read_cohort(config: Mapping, results: str) -> Cohort:
    """The cohort of a configuration; the files of virtual patients lie in `results`/virtual/{case}/. InputError for
    a table that is none."""
    if config["cohort"] != "virtual":
        table, cases = config["cohort"], read_cases(config["cohort"])
        left_out = {case.name: case.left_out for case in cases if case.left_out}
        taken = {case.name: case for case in cases if not case.left_out}
        return Cohort(called(Path(table).stem, left_out), taken)
    virtual = config["virtual"]
    cases = virtual_cases(virtual["patients"], f"{results}/virtual", virtual["without"])
    return Cohort(
        # A name says of a virtual cohort whether settings are chosen on it.
        name=called(f"virtual cohort ({virtual['role']})", virtual["without"]),
        cases={case.name: case for case in cases},
        virtual=True,
        locked=virtual["role"] == LOCKED,
    )


def called(cohort: str, left_out: Mapping[str, str]) -> str:
    """What tables call a cohort: who is left out of it, and why, belongs to its name."""
    return f"{cohort}, without {', '.join(f'{name} ({why})' for name, why in left_out.items())}" if left_out else cohort


def virtual_names(patients: int) -> list[str]:
    """Names of the virtual patients in the order in which they are drawn."""
    width = max(2, len(str(patients)))
    return [f"V{number:0{width}d}" for number in range(1, patients + 1)]


def virtual_cases(patients: int, folder: str, without: Collection[str] = ()) -> list[Case]:
    """The cases of the virtual cohort but those `without`; their files lie in `folder`/{case}/."""
    return [
        Case(
            name,
            f"{folder}/{name}/segmentation.nii.gz",
            f"{folder}/{name}/plan.json",
            f"{folder}/{name}/postop.ply",
            f"{folder}/{name}/postop_bones.nii.gz",
            covariates_file=f"{folder}/{name}/covariates.json",
        )
        for name in virtual_names(patients)
        if name not in without
    ]
