"""Makes the accuracy table: each method's mean and spread, tested against the reference method."""

from collections.abc import Sequence

from pinnochio.evaluation.accuracy import summarise, write_accuracy
from pinnochio.evaluation.published import ordering, published_block
from pinnochio.evaluation.tables import CASES, read_table, scanned
from pinnochio.logs import attach_log


def compare_methods(
    cases: str, methods: Sequence[str], reference: str | None, cohort: str, seed: int, published: bool, table: str
) -> None:
    """Summarise cases.csv by method (paired Wilcoxon tests, Holm-corrected) and write the table with its twins.

    The patients with a post-operative scan count. Without a reference, which may be left out, nothing is tested.
    published: whether the paper's own values, and how the orderings agree, stand below it in the twins.
    """
    rows = scanned(read_table(cases, CASES))
    summary = summarise(rows, reference, methods, seed)
    further = [published_block()] if published else []
    paragraphs = ordering(rows, summary, cohort, seed) if published else []
    write_accuracy(summary, table, cohort, further, paragraphs)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    compare_methods(
        snakemake.input.cases,
        snakemake.params.methods,
        snakemake.params.reference,
        snakemake.params.cohort,
        snakemake.params.seed,
        snakemake.params.published,
        snakemake.output.table,
    )
