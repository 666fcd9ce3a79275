"""Makes the design table: what each switch of the better network is worth on the folds that were trained."""

from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio.logs import attach_log
from pinnochio.overlays import changes
from pinnochio.tables.ablation import write_design
from pinnochio.tables.engine import CASES, read_table, scanned


def compare_designs(
    metrics: Sequence[str], variants: Mapping[str, Mapping], cohort: str, seed: int, table: str
) -> None:
    """Compare the networks of `variants`, settings by method, the base first, on the patients of the metrics files."""
    rows = pd.concat([read_table(path, CASES) for path in metrics], ignore_index=True)
    base = next(iter(variants.values()))
    named = {name: ", ".join(changes(base, settings)) for name, settings in variants.items()}
    write_design(scanned(rows), named, table, cohort, seed)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    compare_designs(
        metrics=snakemake.input.metrics,
        variants=snakemake.params.variants,
        cohort=snakemake.params.cohort,
        seed=snakemake.params.seed,
        table=snakemake.output.table,
    )
