"""The table behind the trade-off: one row per patient and setting."""

import os
from collections.abc import Sequence

from pinnochio.columns import Column, number, read_tables
from pinnochio.metrics.case_columns import BY_NAME
from pinnochio.tables.document import Block, Table, views
from studies.tradeoff.setting_columns import SETTING

TRADEOFF_CASES = (
    Column("case", str, "", "patient"),
    *SETTING,
    Column("nodes", int, "", "nodes of the mesh"),
    *(BY_NAME[name] for name in ("seconds", "setup_seconds", "threads", "converged")),
    number("face_error", "mm", "mean distance of the judged face from the reference solution"),
    number("face_error_max", "mm", "largest of the judged face"),
    number("volume_error", "mm", "mean distance from the reference solution over the tissue's volume"),
    *(BY_NAME[name] for name in ("eqres_rel", "min_jacobian", "inverted")),
)


def tabulate(rows: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The rows of the patients and families of methods, one file after the other."""
    frame = read_tables(rows, TRADEOFF_CASES)
    caption = f"Every setting on every patient, {cohort}; what the columns say stands below."
    return Table(frame, TRADEOFF_CASES, [Block.of(frame, views(TRADEOFF_CASES), caption)])
