"""Makes the accuracy table: each method's mean and spread, tested against the reference method."""

from collections.abc import Sequence

from pinnochio.evaluation.tables import CASES, read_table, scanned, summarise, write_accuracy
from pinnochio.logs import attach_log


def compare_methods(
    cases: str, methods: Sequence[str], reference: str | None, cohort: str, seed: int, table: str
) -> None:
    """Summarise cases.csv by method (paired Wilcoxon tests, Holm-corrected) and write the table with its twins.

    The patients with a post-operative scan count. Without a reference, which may be left out, nothing is tested.
    """
    rows = read_table(cases, CASES)
    write_accuracy(summarise(scanned(rows), reference, methods, seed), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    compare_methods(
        snakemake.input.cases,
        snakemake.params.methods,
        snakemake.params.reference,
        snakemake.params.cohort,
        snakemake.params.seed,
        snakemake.output.table,
    )
