"""Makes the table of scenes of the patients' trials."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table
from pinnochio.tables.reductions import TRIALS, collect, write_scenes


def collect_scenes(trials: Sequence[str], cohort: str, table: str) -> None:
    """Average the patients' trials by plan and model; the cohort's name goes into the captions."""
    write_scenes(collect([read_table(path, TRIALS) for path in trials]), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_scenes(trials=snakemake.input.trials, cohort=snakemake.params.cohort, table=snakemake.output.table)
