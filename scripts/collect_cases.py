"""Makes the table with one row per case and method of the folds' metrics."""

from collections.abc import Sequence

import pandas as pd

from pinnochio.logs import attach_log
from pinnochio.tables.engine import CASES, read_table, write_cases


def collect_cases(metrics: Sequence[str], cohort: str, table: str) -> None:
    """Concatenate the metrics; the cohort's name goes into the captions of the twins beside `table`."""
    write_cases(pd.concat([read_table(path, CASES) for path in metrics]), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_cases(metrics=snakemake.input.metrics, cohort=snakemake.params.cohort, table=snakemake.output.table)
