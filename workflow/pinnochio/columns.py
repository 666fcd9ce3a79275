"""The columns of a table: one declaration of each, by which tables are checked, written and read.

pandas and pandera take two seconds to load, as long as many a stage's own work: only what handles whole tables does.
"""

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

from pinnochio.errors import InputError, damaged
from pinnochio.files import replacing
from pinnochio.json_text import read_stored_text


@dataclass(frozen=True)
class Column:
    """A column: kind str | int | float | bool; `format` as in format(); optional ones may be empty."""

    name: str
    kind: type
    unit: str
    description: str
    format: str = ""
    optional: bool = False

    @property
    def summary(self) -> str:
        """Format of a mean of the column."""
        return SHOWN if self.format == TESTED else self.format

    def text(self, value) -> str:
        """A value as every file shows it; empty for NaN."""
        return "" if _is_empty(value) else format(self.kind(value), self.format)


SHOWN, TESTED = ".4f", ".7f"  # what is tested has digits enough for rounding not to make ties


def number(name: str, unit: str, description: str, form: str = SHOWN) -> Column:
    """A column of numbers, any of which may be missing."""
    return Column(name, float, unit, description, form, optional=True)


def words(name: str) -> str:
    """A name as it is read."""
    return name.replace("_", " ")


def _is_empty(value: Any) -> bool:
    return value is None or value == "" or bool(isinstance(value, Real) and value != value)


DTYPES = {str: str, int: "Int64", float: float, bool: bool}
WORDS = {str: "text", int: "a whole number", float: "a number", bool: "True or False"}
# By pandera's name of the reason.
PROBLEMS = {
    "COLUMN_NOT_IN_DATAFRAME": "is missing",
    "COLUMN_NOT_IN_SCHEMA": "is not in the schema",
    "COLUMN_NOT_ORDERED": "is out of place",
    "SERIES_CONTAINS_NULLS": "has an empty cell",
}


def check(frame: "pd.DataFrame", columns: Sequence[Column], file: object = "table") -> "pd.DataFrame":
    """The frame in the order and the kinds of the columns, empty texts as "".

    InputError names the file and the column that does not fit, is missing or is not among them.
    """
    names = [column.name for column in columns]
    return _validated(
        frame[sorted(frame, key=lambda name: names.index(name) if name in names else len(names))], columns, file
    )


def _validated(frame: "pd.DataFrame", columns: Sequence[Column], file: object) -> "pd.DataFrame":
    import pandera.pandas as pa

    kinds = {column.name: column.kind for column in columns}
    if frame.empty:
        raise _refusal(file, "it has no row")
    # A float that is not whole must not become one, nor a number a truth value: bool is not coerced.
    schema = pa.DataFrameSchema(
        {
            column.name: pa.Column(DTYPES[column.kind], coerce=column.kind is not bool, nullable=column.optional)
            for column in columns
        },
        strict=True,
        ordered=True,
    )
    try:
        checked = schema.validate(frame.replace("", np.nan).infer_objects(), lazy=True)
    except pa.errors.SchemaErrors as errors:
        worst = list(PROBLEMS)
        error = min(
            errors.schema_errors,
            key=lambda error: worst.index(error.reason_code.name) if error.reason_code.name in PROBLEMS else len(worst),
        )
        name = error.column_name or error.schema.name or error.failure_cases
        problem = PROBLEMS.get(error.reason_code.name) or f"holds something that is not {WORDS[kinds[name]]}"
        raise _refusal(file, f"column {name!r} {problem}") from None
    checked = checked.astype({name: int for name, kind in kinds.items() if kind is int})
    return checked.fillna({name: "" for name, kind in kinds.items() if kind is str}).reset_index(drop=True)


def _refusal(file: object, problem: str) -> InputError:
    return InputError("-", file, problem, "make the table again with the code that reads it")


def read_csv(path: str | os.PathLike, **options) -> "pd.DataFrame":
    """A CSV file of the study as pandas reads it with these options; InputError where it is damaged."""
    import pandas as pd

    content = read_stored_text(path).encode()
    try:
        frame = pd.read_csv(io.BytesIO(content), **options)
        if len(frame) and not isinstance(frame.index, pd.RangeIndex):  # pandas takes the first cells for an index
            raise ValueError("its rows have more cells than its first line")
    except ValueError as error:  # so are all that pandas raises
        raise damaged(path, error) from error
    return frame


def read_table(path: str | os.PathLike, columns: Sequence[Column]) -> "pd.DataFrame":
    """Read and check a CSV table; InputError as of :func:`read_csv` and :func:`check`."""
    texts = {column.name: str for column in columns if column.kind is str}
    empty = {column.name: [""] for column in columns if column.kind is not str}
    frame = read_csv(path, dtype=texts, keep_default_na=False, na_values=empty, float_precision="round_trip")
    return _validated(frame, columns, path)


def read_tables(paths: Sequence[str | os.PathLike], columns: Sequence[Column]) -> "pd.DataFrame":
    """The rows of several CSV tables, one table after the other."""
    import pandas as pd

    return pd.concat([read_table(path, columns) for path in paths], ignore_index=True)


def write_csv(frame: "pd.DataFrame", path: str | os.PathLike, columns: Sequence[Column]) -> "pd.DataFrame":
    """Check and write a table as CSV, numbers in the columns' formats; returns the checked frame."""
    frame = check(frame, columns, path)
    _write(frame.to_dict("records"), path, columns)
    return frame


def write_rows(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike, columns: Sequence[Column]) -> None:
    """The same of the rows that a stage has measured; refused as by :func:`check`."""
    if not rows:
        raise _refusal(path, "it has no row")
    names = {column.name for column in columns}
    for row in rows:
        if odd := [name for name in row if name not in names]:
            raise _refusal(path, f"column {odd[0]!r} {PROBLEMS['COLUMN_NOT_IN_SCHEMA']}")
        for column in columns:
            if problem := _problem(row, column):
                raise _refusal(path, f"column {column.name!r} {problem}")
    _write(rows, path, columns)


def _problem(row: Mapping[str, Any], column: Column) -> str:
    """What is wrong with a row's value, "" if nothing is."""
    if column.name not in row:
        return PROBLEMS["COLUMN_NOT_IN_DATAFRAME"]
    value = row[column.name]
    if _is_empty(value):
        return "" if column.optional else PROBLEMS["SERIES_CONTAINS_NULLS"]
    truth = isinstance(value, bool | np.bool_)
    number = isinstance(value, Real) and not truth
    fits = {str: isinstance(value, str), bool: truth, float: number, int: number and value % 1 == 0}
    return "" if fits[column.kind] else f"holds something that is not {WORDS[column.kind]}"


def _write(rows: Iterable[Mapping[str, Any]], path: str | os.PathLike, columns: Sequence[Column]) -> None:
    with replacing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        writer.writerows([column.text(row[column.name]) for column in columns] for row in rows)
