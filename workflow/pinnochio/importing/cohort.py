"""The table of a cohort: its patients, where their files lie and what else is known of them."""

import csv
import io
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pinnochio.errors import InputError, Refuse, refusal
from pinnochio.files import check_brought, check_name
from pinnochio.json_text import meant, read_text

SEPARATORS = "\t;,"
COLUMNS = ("case", "segmentation", "plan", "postop")
FILES = ("segmentation", "plan", "postop", "postop_bones", "volume", "markups")
OPTIONAL_FILES = ("postop", "postop_bones", "volume", "markups")
FRAME = "postop_frame"
LEFT_OUT = "left_out"  # why a patient takes no part, in words that the tables repeat
BONES = "bones"  # `postop_frame` of a skin of the same scan as the post-operative bones
# What may be a folder: of surfaces, of images, of transforms, of markups, of a series of DICOM.
FOLDERS = ("segmentation", "plan", "postop_bones", "markups", "volume")


def decimal(text: str) -> float:
    """A number whose decimal sign is a point or a comma; ValueError for anything else."""
    if "_" in text:  # Python's own sign between digits
        raise ValueError
    return float(text if "." in text else text.replace(",", ".", 1))


def _number(low: float, high: float, unit: str):
    """Reader of a number within bounds."""

    def read(text: str) -> float:
        value = decimal(text)  # NaN lies in no bounds
        if not low <= value <= high:
            raise ValueError
        return value

    return read, f"a number of {unit} from {low:g} to {high:g}"


def _word(**values):
    """Reader of one of these words."""
    return lambda text: values[text.lower()], " or ".join(values)


# Column -> reader of its text, and what it may hold.
COVARIATES = {
    "sex": _word(female="female", male="male"),
    "age": _number(5, 110, "years"),
    "bmi": _number(10, 80, "kg/m2"),
    "months": _number(0, 600, "months from surgery to the scan"),
    "closure": _word(vy="vy", simple="simple"),
    "cinch": _word(yes=True, no=False),
}


@dataclass(frozen=True)
class Case:
    """One patient of a cohort table; `postop` is empty where there is no post-operative scan, `postop_bones` where
    there are no post-operative bones; postop_frame: BONES where both are of one scan, else empty. volume: the scan,
    where soft tissue is taken from it; markups: file or folder.

    covariates: those of :data:`COVARIATES` that are known; covariates_file: JSON that holds them instead. left_out: why
    the patient takes no part; nothing else is known of such a one.
    """

    name: str
    segmentation: str
    plan: str = ""
    postop: str = ""
    postop_bones: str = ""
    covariates: Mapping[str, str | float | bool] = field(default_factory=dict)
    covariates_file: str = ""
    volume: str = ""
    markups: str = ""
    postop_frame: str = ""
    left_out: str = ""


def read_cases(table: str | os.PathLike) -> list[Case]:
    """Read a cohort table (paths relative to the table) and check files and values.

    :data:`COLUMNS` must be there; `postop_bones`, `volume`, `markups`, `postop_frame`, `left_out` and
    :data:`COVARIATES` may; the order is free. Of a patient that is left out no file is looked at.
    """
    table = Path(table)
    refuse = refusal("-", table)
    if not table.is_file():
        refuse("the cohort table does not exist", "set 'cohort' to 'virtual' or to a table")
    columns, *listed = read_rows(table, refuse)
    _check_columns(columns, table)
    rows = [dict(zip(columns, row, strict=True)) for row in listed]
    cases = []
    for row in rows:
        name = row["case"]
        check_name(name or "-", name, table)
        if same := [case.name for case in cases if case.name.lower() == name.lower()]:
            problem = "two rows carry this name" if name in same else f"{same[0]!r} is the same name but for its case"
            raise InputError(name, table, problem, "give each case its own name, once")
        if reason := row.get(LEFT_OUT, ""):
            cases.append(Case(name, "", left_out=reason))
            continue
        paths = {key: str(table.parent / row[key]) if row.get(key) else "" for key in FILES}
        for key, path in paths.items():
            if not path and key not in OPTIONAL_FILES:
                raise InputError(name, table, f"column {key} is empty", f"name the {key} file of the case")
            if path and not (os.path.isfile(path) or (key in FOLDERS and os.path.isdir(path))):
                raise InputError(name, path, f"the {key} file does not exist", f"correct the path in {table}")
            if path:
                check_brought(name, path)
        frame = row.get(FRAME, "")
        if frame not in ("", BONES):
            raise InputError(name, table, f"{FRAME} holds {frame!r}", f"write {BONES}, or leave it empty")
        if frame and not (paths["postop"] and paths["postop_bones"]):
            problem, remedy = f"{FRAME} is {BONES}, and postop or postop_bones is empty", "give both, of one scan"
            raise InputError(name, table, problem, remedy)
        cases.append(Case(name, **paths, covariates=covariates_of(row, name, table), postop_frame=frame))
    if all(case.left_out for case in cases):
        refuse("the cohort table has no case", "add one row per case")
    return cases


def separator(text: str) -> str:
    """What parts the cells of a table: a tab, a semicolon or a comma, by its first line that is not empty."""
    first = text.lstrip(SEPARATORS + "\r\n ").partition("\n")[0]
    return max(SEPARATORS, key=first.count)


def read_rows(path: str | os.PathLike, refuse: Refuse) -> list[list[str]]:
    """Rows of cells, the first one of names, without the empty rows and columns that spreadsheets leave behind, and
    without their line `sep=;`; refused where a row has more or fewer cells than the first."""
    if str(path).lower().endswith((".xlsx", ".xls", ".ods")):
        refuse("it is a workbook, not a text", "save its sheet as CSV in UTF-8")
    text = re.sub(r"\A\s*\"?sep=.\"?\r?\n", "", read_text(path, refuse))
    try:
        # newline="": the reader's own ends of lines
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator(text), strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        refuse(f"it is no table ({error})", "save it as text in UTF-8, its cells separated by tabs")
    rows = [(line, row) for line, row in rows if any(row)] or [(1, [])]
    first = rows[0][1]
    for line, row in rows:
        if len(row) != len(first):
            problem = f"line {line} has {len(row)} cells, the first line {len(first)}"
            refuse(problem, "give each row one cell per column, separated as in the first line")
    width = 1 + max((at for _, row in rows for at, cell in enumerate(row) if cell), default=-1)
    return [row[:width] for _, row in rows]


def _check_columns(columns: list[str], table: Path) -> None:
    refuse = refusal("-", table)
    known = (*COLUMNS, *FILES[len(COLUMNS) - 1 :], FRAME, LEFT_OUT, *COVARIATES)
    remedy = f"use columns {', '.join(COLUMNS)}, separated by tabs, and any of {', '.join(known[len(COLUMNS) :])}"
    for name in columns:
        if name not in known:
            refuse(f"its column {name!r} is unknown{meant(name, known)}", remedy)
        if columns.count(name) > 1:
            refuse(f"its column {name!r} is there twice", remedy)
    if missing := [name for name in COLUMNS if name not in columns]:
        refuse(f"it lacks the column {missing[0]!r}; its columns are {columns}", remedy)


def covariates_of(row: Mapping[str, str], name: str, file: str | os.PathLike) -> dict[str, str | float | bool]:
    """The covariates of a row of texts; what is empty is not known. InputError names the patient and the file."""
    values = {}
    for key, (read, allowed) in COVARIATES.items():
        if text := row.get(key):
            try:
                values[key] = read(text)
            except (ValueError, KeyError):
                problem = f"{key} holds {text!r}"
                raise InputError(name, file, problem, f"write {allowed}, or leave it empty") from None
    return values
