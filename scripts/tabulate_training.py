"""Makes the table of the training budget of each learned method."""

from collections.abc import Mapping, Sequence

from pinnochio.logs import attach_log
from pinnochio.tables.training import budget, write_budget


def tabulate_training(
    networks: Sequence[str],
    settings: Mapping[str, Mapping],
    folds: Sequence[str],
    benchmarks: str,
    cohort: str,
    table: str,
) -> None:
    """Write training.csv and its twins of settings by method; networks: every method's files, fold by fold."""
    files = {name: networks[i * len(folds) : (i + 1) * len(folds)] for i, name in enumerate(settings)}
    write_budget(budget(settings, files, folds, benchmarks), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    tabulate_training(
        networks=snakemake.input.networks,
        settings=snakemake.params.settings,
        folds=snakemake.params.folds,
        benchmarks=snakemake.params.benchmarks,
        cohort=snakemake.params.cohort,
        table=snakemake.output.table,
    )
