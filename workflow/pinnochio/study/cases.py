"""The cases of a cohort, and the folds that hold them out."""

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.seeds import generator

COLUMNS = ("case", "segmentation", "plan", "postop")


@dataclass(frozen=True)
class Case:
    """One patient of a cohort table; `postop` is empty where there is no post-operative scan."""

    name: str
    segmentation: str
    plan: str
    postop: str = ""


def virtual_cases(patients: int, folder: str) -> list[Case]:
    """The cases of the virtual cohort; their files lie in `folder`/{case}/."""
    width = max(2, len(str(patients)))
    names = [f"V{number:0{width}d}" for number in range(1, patients + 1)]
    return [
        Case(
            name,
            f"{folder}/{name}/segmentation.nii.gz",
            f"{folder}/{name}/plan.json",
            f"{folder}/{name}/postop.ply",
        )
        for name in names
    ]


def read_cases(table: str | os.PathLike) -> list[Case]:
    """Read a cohort table (tab-separated; paths relative to the table) and check that its files exist."""
    table = Path(table)
    if not table.is_file():
        raise InputError("-", table, "the cohort table does not exist", "set 'cohort' to 'virtual' or to a table")
    with open(table, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file, delimiter="\t")
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise InputError(
                "-",
                table,
                f"its columns are {reader.fieldnames}",
                f"use tab-separated columns {', '.join(COLUMNS)}",
            )
        rows = [{key: (value or "").strip() for key, value in row.items() if key} for row in reader]
    cases = []
    for row in rows:
        name = row["case"]
        if not name.replace("_", "").replace("-", "").isalnum():
            raise InputError(name, table, "the name is not of letters, digits, '-' and '_'", "rename the case")
        if name in {case.name for case in cases}:
            raise InputError(name, table, "two rows carry this name", "give each case its own name, once")
        paths = {key: str(table.parent / row[key]) if row[key] else "" for key in COLUMNS[1:]}
        for key, path in paths.items():
            if not path and key != "postop":
                raise InputError(name, table, f"column {key} is empty", f"name the {key} file of the case")
            # A segmentation may be a folder of surfaces, a plan one of transforms.
            if path and not (Path(path).is_file() or (key != "postop" and Path(path).is_dir())):
                raise InputError(name, path, f"the {key} file does not exist", f"correct the path in {table}")
        cases.append(Case(name, **paths))
    if not cases:
        raise InputError("-", table, "the cohort table has no case", "add one row per case")
    return cases


def assign_folds(scanned: Sequence[str], unscanned: Sequence[str], folds: int, seed: int) -> dict[str, list[str]]:
    """Held-out cases of each fold ("1", "2", ...), drawn once from the seed; fold sizes differ by at most one.

    The patients without a post-operative scan are dealt after the scanned ones, whose folds they leave as they are.
    """
    held_out: dict[str, list[str]] = {str(fold + 1): [] for fold in range(folds)}
    shuffled = [
        group[i]
        for group in (scanned, unscanned)
        for i in generator(seed, "folds", ",".join(group)).permutation(len(group))
    ]
    for number, name in enumerate(shuffled):
        held_out[str(number % folds + 1)].append(name)
    return {fold: sorted(cases) for fold, cases in held_out.items() if cases}


def external_file(folder: str | os.PathLike, case: str) -> str:
    """The file in which a method made elsewhere delivers a case: {case}.npz, else {case}.vtu."""
    names = [f"{case}.npz", f"{case}.vtu"]
    for name in names:
        if (Path(folder) / name).is_file():
            return str(Path(folder) / name)
    raise InputError(
        case, folder, f"there is neither {names[0]} nor {names[1]}", "put the prediction of every case into the folder"
    )
