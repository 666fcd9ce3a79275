"""Cases, folds and the checks of a study's configuration that a schema cannot express."""

import csv
import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
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
            if path and not Path(path).is_file():
                raise InputError(name, path, f"the {key} file does not exist", f"correct the path in {table}")
        cases.append(Case(name, **paths))
    if not cases:
        raise InputError("-", table, "the cohort table has no case", "add one row per case")
    return cases


def assign_folds(names: Sequence[str], folds: int, seed: int) -> dict[str, list[str]]:
    """Held-out cases of each fold ("1", "2", ...), drawn once from the seed; fold sizes differ by at most one."""
    order = generator(seed, "folds", ",".join(names)).permutation(len(names))
    held_out = {str(fold + 1): sorted(names[i] for i in order[fold::folds]) for fold in range(folds)}
    return {fold: cases for fold, cases in held_out.items() if cases}


def check_config(config: Mapping) -> None:
    """Refuse a configuration whose keys contradict each other; the message names the keys."""

    def refuse(problem: str, remedy: str):
        raise InputError("-", "configuration", problem, remedy)

    known = ["superficial", "muscle", "cranium", *config["segments"]]
    labels = config["labels"]
    if missing := [name for name in config["segments"] if name not in labels]:
        refuse(f"segments {missing} have no entry in 'labels'", "give each segment its voxel value")
    values = [labels[name] for name in known]
    if len(set(values)) < len(values):
        refuse("two structures share one value in 'labels'", "give each structure its own value")
    if config["reference"] not in config["methods"]:
        refuse(f"reference {config['reference']!r} is not among 'methods'", "add it, or choose another reference")
    if config["network"]["channels"] % config["network"]["heads"]:
        refuse("network.channels is no multiple of network.heads", "choose channels = heads x features per head")
    if config["cohort"] == "virtual" and config["virtual"]["patients"] < config["folds"]:
        refuse("there are fewer virtual patients than folds", "lower 'folds' or raise virtual.patients")


def code_hash(files: Iterable[str | os.PathLike], root: str | os.PathLike) -> str:
    """Short content hash of source files; depends on their paths below `root` alone, not on where that lies."""
    digest = hashlib.sha256()
    for path in sorted(Path(file) for file in files):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]
