"""Makes the accuracy table: each method's mean and spread, tested against the reference method."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.tables.accuracy import summarise, write_accuracy
from pinnochio.tables.engine import CASES, read_table, scanned
from pinnochio.tables.published import ordering, published_block


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
        cases=snakemake.input.cases,
        methods=snakemake.params.methods,
        reference=snakemake.params.reference,
        cohort=snakemake.params.cohort,
        seed=snakemake.params.seed,
        published=snakemake.params.published,
        table=snakemake.output.table,
    )
