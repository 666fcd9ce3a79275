"""Makes the dial's table of the metrics of predictions and of their corrected fields."""

from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio.logs import attach_log
from pinnochio.tables.corrections import summarise, write_corrections
from pinnochio.tables.engine import CASES, read_table


def tabulate_corrections(metrics: Mapping[tuple[str, int], Sequence[str]], cohort: str, seed: int, table: str) -> None:
    """Summarise the folds' metrics by method and number of corrections; the cohort's name goes into the captions."""
    rows = {key: pd.concat([read_table(path, CASES) for path in paths]) for key, paths in metrics.items()}
    write_corrections(summarise(rows, seed), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    paths, folds = iter(snakemake.input.metrics), range(snakemake.params.folds)
    tabulate_corrections(
        metrics={
            (method, corrections): [next(paths) for _ in folds]
            for method in snakemake.params.methods
            for corrections in snakemake.params.corrections
        },
        cohort=snakemake.params.cohort,
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
