"""The columns of a table: one declaration of each, by which tables are checked, written and read."""

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pinnochio.errors import InputError, damaged
from pinnochio.files import replacing
from pinnochio.json_text import read_own_text


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
        return "" if pd.isna(value) else format(self.kind(value), self.format)


SHOWN, TESTED = ".4f", ".7f"  # what is tested has digits enough for rounding not to make ties


def number(name: str, unit: str, description: str, form: str = SHOWN) -> Column:
    """A column of numbers, any of which may be missing."""
    return Column(name, float, unit, description, form, optional=True)


def words(name: str) -> str:
    """A name as it is read."""
    return name.replace("_", " ")


DTYPES = {str: str, int: "Int64", float: float, bool: bool}
WORDS = {str: "text", int: "a whole number", float: "a number", bool: "True or False"}
# By pandera's name of the reason.
PROBLEMS = {
    "COLUMN_NOT_IN_DATAFRAME": "is missing",
    "COLUMN_NOT_IN_SCHEMA": "is not in the schema",
    "COLUMN_NOT_ORDERED": "is out of place",
    "SERIES_CONTAINS_NULLS": "has an empty cell",
}


def check(frame: pd.DataFrame, columns: Sequence[Column], file: object = "table") -> pd.DataFrame:
    """The frame in the order and the kinds of the columns, empty texts as "".

    InputError names the file and the column that does not fit, is missing or is not among them.
    """
    names = [column.name for column in columns]
    return _validated(
        frame[sorted(frame, key=lambda name: names.index(name) if name in names else len(names))], columns, file
    )


def _validated(frame: pd.DataFrame, columns: Sequence[Column], file: object) -> pd.DataFrame:
    import pandera.pandas as pa  # takes a fifth of a second, which scripts without a table are spared

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


def read_csv(path: str | os.PathLike, **options) -> pd.DataFrame:
    """A CSV file of the study as pandas reads it with these options; InputError where it is damaged."""
    content = read_own_text(path).encode()
    try:
        frame = pd.read_csv(io.BytesIO(content), **options)
        if len(frame) and not isinstance(frame.index, pd.RangeIndex):  # pandas takes the first cells for an index
            raise ValueError("its rows have more cells than its first line")
    except ValueError as error:  # so are all that pandas raises
        raise damaged(path, error) from error
    return frame


def read_table(path: str | os.PathLike, columns: Sequence[Column]) -> pd.DataFrame:
    """Read and check a CSV table; InputError as of :func:`read_csv` and :func:`check`."""
    texts = {column.name: str for column in columns if column.kind is str}
    empty = {column.name: [""] for column in columns if column.kind is not str}
    frame = read_csv(path, dtype=texts, keep_default_na=False, na_values=empty, float_precision="round_trip")
    return _validated(frame, columns, path)


def read_tables(paths: Sequence[str | os.PathLike], columns: Sequence[Column]) -> pd.DataFrame:
    """The rows of several CSV tables, one table after the other."""
    return pd.concat([read_table(path, columns) for path in paths], ignore_index=True)


def write_csv(frame: pd.DataFrame, path: str | os.PathLike, columns: Sequence[Column]) -> pd.DataFrame:
    """Check and write a table as CSV, numbers in the columns' formats; returns the checked frame."""
    frame = check(frame, columns, path)
    text = pd.DataFrame({column.name: frame[column.name].map(column.text) for column in columns})
    with replacing(path) as temporary:
        text.to_csv(temporary, index=False, lineterminator="\n")
    return frame
