"""Makes the dial's table of the metrics of predictions and of their corrected fields."""

from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio.evaluation.dial import summarise, write_dial
from pinnochio.evaluation.tables import CASES, read_table
from pinnochio.logs import attach_log


def collect_dial(metrics: Mapping[tuple[str, int], Sequence[str]], cohort: str, seed: int, table: str) -> None:
    """Summarise the folds' metrics by method and number of corrections; the cohort's name goes into the captions."""
    rows = {key: pd.concat([read_table(path, CASES) for path in paths]) for key, paths in metrics.items()}
    write_dial(summarise(rows, seed), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    paths, folds = iter(snakemake.input.metrics), range(snakemake.params.folds)
    collect_dial(
        {
            (method, corrections): [next(paths) for _ in folds]
            for method in snakemake.params.methods
            for corrections in snakemake.params.corrections
        },
        snakemake.params.cohort,
        snakemake.params.seed,
        snakemake.output.table,
    )
