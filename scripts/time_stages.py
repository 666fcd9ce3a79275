"""Makes the table of time per stage of the benchmark files of the study's jobs."""

from pinnochio.evaluation.benchmarks import stages, write_stages
from pinnochio.logs import attach_log


def time_stages(benchmarks: str, cohort: str, table: str) -> None:
    """Sum up the files {rule}/*.tsv below the folder `benchmarks`; the cohort's name goes into the captions."""
    write_stages(stages(benchmarks), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    time_stages(snakemake.params.benchmarks, snakemake.params.cohort, snakemake.output.table)
