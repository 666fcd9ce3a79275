"""Makes the table of coverage by method and region of the tables of the methods."""

from collections.abc import Sequence

import pandas as pd

from pinnochio.logs import attach_log
from pinnochio.tables.coverage import COVERAGE, write_coverage
from pinnochio.tables.engine import read_table


def collect_coverage(parts: Sequence[str], cohort: str, table: str) -> None:
    """Stack the tables in the given order; the cohort's name goes into the captions of the twins beside `table`."""
    write_coverage(pd.concat([read_table(path, COVERAGE) for path in parts]), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_coverage(parts=snakemake.input.parts, cohort=snakemake.params.cohort, table=snakemake.output.table)
