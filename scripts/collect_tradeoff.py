"""Makes the trade-off's tables of the rows of every patient."""

from collections.abc import Sequence

import pandas as pd

from pinnochio.experiments.tradeoff_choice import CHOICES, check_choices, choices_block
from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table, write_csv
from pinnochio.tables.tradeoff import TRADEOFF_CASES, summarise, write_tradeoff


def collect_tradeoff(
    rows: Sequence[str],
    budgets: Sequence[float],
    tolerances: Sequence[float],
    cohort: str,
    table: str,
    cases: str,
    choices: str,
) -> None:
    """Write the table with its fronts, the rows of all patients, and what choices from the fronts are worth.

    Budgets in s and tolerances in mm are tried on each patient with the front of the others; of one patient alone
    nothing can be tried.
    """
    found = pd.concat([read_table(path, TRADEOFF_CASES) for path in rows], ignore_index=True)
    write_csv(found, cases, TRADEOFF_CASES)
    tried = write_csv(check_choices(found, budgets, tolerances), choices, CHOICES)
    write_tradeoff(summarise(found), table, cohort, [choices_block(tried, cohort)])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_tradeoff(
        rows=snakemake.input.rows,
        budgets=snakemake.params.budgets,
        tolerances=snakemake.params.tolerances,
        cohort=snakemake.params.cohort,
        table=snakemake.output.table,
        cases=snakemake.output.cases,
        choices=snakemake.output.choices,
    )
