"""Files of several patients as one input of a job: a folder, in which the name of a file begins with its patient's.

A training on 10,000 patients would else name 60,000 files, which Snakemake looks up for each of its trainings.
"""

import os
from collections.abc import Mapping, Sequence

from pinnochio.errors import REMEDY, InputError

# Argument of a stage -> input of its job that gathers such files, and the file of a patient.
FILES = {
    "models": ("models", "model.h5"),
    "lifts": ("lifts", "lift_elastic.h5"),
    "fem_samples": ("samples", "fem_samples.h5"),
    "plans": ("scans", "motion.json"),
    "postops": ("scans", "postop.h5"),
    "covariates": ("covariates", "covariates.json"),
}


def gathered_files(inputs: Mapping[str, Sequence[str]], cases: Sequence[str], *names: str) -> dict[str, list[str]]:
    """Files of the cases, in their order, by these arguments of a stage; none of a kind that is no input of the job."""
    return {name: gathered(inputs.get(FILES[name][0], []), cases, FILES[name][1]) for name in names}


def gathered_name(case: str, file: str) -> str:
    """What a file of a patient, such as lips/model.h5, is called there."""
    return f"{case}.{file.replace('/', '_')}"


def gathered(folders: Sequence[str], cases: Sequence[str], file: str, some: bool = True) -> list[str]:
    """The file of each case in the one of the folders that has it; none without folders, and where there is none of any
    and it may be so (some: it may not). InputError where one lacks."""
    there = {entry.name: entry.path for folder in folders for entry in os.scandir(folder)}
    paths = {case: there.get(gathered_name(case, file)) for case in cases if folders}
    if not some and not any(paths.values()):
        return []
    if missing := [case for case, path in paths.items() if not path]:
        raise InputError(missing[0], folders[0], f"there is no {file}", REMEDY)
    return list(paths.values())
