"""The table of everything that is measured: one row per case and method."""

import os
from collections.abc import Sequence

from pinnochio.columns import check, read_tables
from pinnochio.metrics.columns import CASES
from pinnochio.tables.document import Block, Table, views


def tabulate(metrics: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The rows of the folds' metrics, sorted by case and method."""
    frame = check(read_tables(metrics, CASES).sort_values(["case", "method"], kind="stable"), CASES)
    caption = f"One row per case and method; {cohort}, {frame['case'].nunique()} patients."
    return Table(frame, CASES, [Block.of(frame, views(CASES), caption)])
