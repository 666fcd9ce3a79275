"""Makes the effect table of the patients' rows."""

from collections.abc import Sequence

import pandas as pd

from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table
from pinnochio.virtual.effects import CASE, summarise, write_summary


def tabulate_effects(rows: Sequence[str], effects: str | dict, table: str) -> None:
    """Mean of each effect over the patients, with its magnitude (`effects`: section of the configuration)."""
    write_summary(summarise(pd.concat([read_table(path, CASE) for path in rows]), effects), table)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    tabulate_effects(rows=snakemake.input.rows, effects=snakemake.params.effects, table=snakemake.output.table)
