"""The table of a cohort: its patients and where their files lie."""

import csv
import os
from dataclasses import dataclass
from pathlib import Path

from pinnochio.errors import InputError

COLUMNS = ("case", "segmentation", "plan", "postop")


@dataclass(frozen=True)
class Case:
    """One patient of a cohort table; `postop` is empty where there is no post-operative scan."""

    name: str
    segmentation: str
    plan: str
    postop: str = ""


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
