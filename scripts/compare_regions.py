"""Makes a table of errors by place: the regions of the face, or landmarks and the whole virtual truth."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.tables.engine import CASES, read_table, scanned
from pinnochio.tables.regions import KINDS, summarise_places, write_places


def compare_regions(
    cases: str, kind: str, methods: Sequence[str], reference: str | None, cohort: str, seed: int, table: str
) -> None:
    """Summarise the scanned patients of cases.csv by method and place of a kind of KINDS, and write the twins.

    Paired Wilcoxon tests against the reference, Holm-corrected per place; without a reference nothing is tested.
    """
    rows = scanned(read_table(cases, CASES))
    write_places(summarise_places(rows, KINDS[kind].places, reference, methods, seed), table, KINDS[kind], cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    compare_regions(
        cases=snakemake.input.cases,
        kind=snakemake.params.kind,
        methods=snakemake.params.methods,
        reference=snakemake.params.reference,
        cohort=snakemake.params.cohort,
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
