"""Makes the table of scenes of the patients' trials."""

from collections.abc import Sequence

from pinnochio.evaluation.scene_table import TRIALS, collect, write_scenes
from pinnochio.evaluation.tables import read_table
from pinnochio.logs import attach_log


def collect_scenes(trials: Sequence[str], cohort: str, table: str) -> None:
    """Average the patients' trials by plan and model; the cohort's name goes into the captions."""
    write_scenes(collect([read_table(path, TRIALS) for path in trials]), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    collect_scenes(snakemake.input.trials, snakemake.params.cohort, snakemake.output.table)
