"""The table of what is fitted to the cost of the stages: exponents of the nodes and of the number of patients."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.tables.document import Block, Table, views
from pinnochio.tables.scaling import read_sizes, size_growths
from pinnochio.tables.scaling_patients import patient_growths, patient_runs, patients

EXPONENTS = (
    Column("stage", str, "", "as in the other tables"),
    Column("against", str, "", "nodes or patients"),
    Column("quantity", str, "", "seconds, cpu_seconds or memory"),
    Column("points", int, "", "sizes that were measured"),
    number("largest", "", "largest of them", ".0f"),
    number("constant", "s or MB", "what does not grow"),
    number("growing", "s or MB", "what grows, at the largest size, as (size / largest) to the exponent"),
    number("exponent", "", "exponent of what grows"),
    number("error", "", "half-width of its 95% interval"),
)


def exponents(sizes: pd.DataFrame, cohort: pd.DataFrame) -> pd.DataFrame:
    """One row of EXPONENTS per stage and quantity of rows of SCALING and PATIENTS."""
    growths = size_growths(sizes) | patient_growths(cohort)
    rows = [dict(zip(("stage", "against", "quantity"), key, strict=True)) | vars(g) for key, g in growths.items()]
    return check(pd.DataFrame(rows), EXPONENTS)


def tabulate(
    sizes: Sequence[str | os.PathLike],
    benchmarks: str | os.PathLike,
    cases: Sequence[str],
    counts: Sequence[int],
    cohort: str,
) -> Table:
    """The fits to the measured sizes and to the stages of the first patients."""
    frame = exponents(read_sizes(sizes), patients(patient_runs(benchmarks, cases), counts))
    caption = f"Fitted to the cost of the stages, {cohort}: constant + growing (size / largest)^exponent."
    return Table(frame, EXPONENTS, [Block.of(frame, views(EXPONENTS), caption)])
