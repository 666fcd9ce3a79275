"""Makes the ablation table: the network without its parts, in the form of the paper's Table 2."""

from collections.abc import Mapping

from pinnochio.logs import attach_log
from pinnochio.tables.ablation import write_ablation
from pinnochio.tables.engine import CASES, read_table, scanned


def ablate(cases: str, variants: Mapping[str, Mapping], cohort: str, seed: int, table: str) -> None:
    """Summarise the scanned patients of cases.csv for `variants`, settings by method; the last is the full model."""
    rows = read_table(cases, CASES)
    write_ablation(scanned(rows), variants, table, cohort, seed)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    ablate(
        cases=snakemake.input.cases,
        variants=snakemake.params.variants,
        cohort=snakemake.params.cohort,
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
