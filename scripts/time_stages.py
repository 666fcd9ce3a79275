"""Makes the table of time per stage of the benchmark files of the study's jobs."""

from pinnochio.logs import attach_log
from pinnochio.tables.cost import stages, write_stages


def time_stages(benchmarks: str, cohort: str, table: str) -> None:
    """Sum up the files {rule}/*.tsv below the folder `benchmarks`; the cohort's name goes into the captions."""
    write_stages(stages(benchmarks), table, cohort)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    time_stages(benchmarks=snakemake.params.benchmarks, cohort=snakemake.params.cohort, table=snakemake.output.table)
