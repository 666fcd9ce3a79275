"""The table of everything that is measured: one row per case and method."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import check, read_tables
from pinnochio.errors import InputError
from pinnochio.metrics.case_columns import CASES
from pinnochio.tables.document import Block, Table, views


def tabulate(metrics: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The rows of the folds' metrics, sorted by case and method."""
    frame = check(read_tables(metrics, CASES).sort_values(["case", "method"], kind="stable"), CASES)
    same_samples(frame)
    caption = f"One row per case and method; {cohort}, {frame['case'].nunique()} patients."
    return Table(frame, CASES, [Block.of(frame, views(CASES), caption)])


def same_samples(cases: pd.DataFrame) -> None:
    """InputError where two methods were judged by different numbers of samples of one case."""
    for name in ("target_samples", "skin_samples"):
        counts = cases.groupby("case")[name].nunique()
        if (counts > 1).any():
            raise InputError(
                counts.idxmax(), "metrics.csv", f"its methods have different {name}", "evaluate all of them again"
            )
