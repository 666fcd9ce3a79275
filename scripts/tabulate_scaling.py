"""Makes the tables of scaling of the measured sizes and of the benchmark files of the study's jobs."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pinnochio.experiments.measuring import megabytes
from pinnochio.logs import attach_log
from pinnochio.tables.engine import read_table
from pinnochio.tables.large_cohort import Measured, paragraphs
from pinnochio.tables.scaling import SCALING, patient_runs, patients, write_scaling


def tabulate_scaling(
    sizes: Sequence[str],
    results: str,
    benchmarks: str,
    held_out: Mapping[str, Sequence[str]],
    training: Mapping[str, int],
    methods: Sequence[str],
    cases: Sequence[str],
    nodes: int,
    counts: Sequence[int],
    cluster: int,
    cohort: str,
    outputs: Mapping[str, str],
) -> None:
    """Write the tables of the sizes and of the first patients, and what a cohort of `cluster` patients would take.

    results, benchmarks: folders of the study; held_out: cases of each fold; training: how many each fold trains on;
    nodes: of the study's meshes; counts: how many patients are added up; outputs as of write_scaling.
    """
    rows = pd.concat([read_table(path, SCALING) for path in sizes])
    rows = pd.concat([own.sort_values("target") for _, own in rows.groupby("stage", sort=False)])
    counted = cases[: max(counts)]
    weight = sum(megabytes(Path(results, part, case)) for case in counted for part in ("virtual", "cases"))
    measured = Measured(benchmarks, cases, held_out, training, methods, rows, nodes, weight / len(counted))
    summed = patients(patient_runs(benchmarks, cases), counts)
    write_scaling(rows, summed, outputs, cohort, paragraphs(measured, cluster, cohort))


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    tabulate_scaling(
        sizes=snakemake.input.sizes,
        results=str(Path(snakemake.output.scaling).parents[1]),
        benchmarks=snakemake.params.benchmarks,
        held_out=snakemake.params.held_out,
        training=snakemake.params.training,
        methods=snakemake.params.methods,
        cases=snakemake.params.cases,
        nodes=snakemake.params.nodes,
        counts=snakemake.params.counts,
        cluster=snakemake.params.cluster,
        cohort=snakemake.params.cohort,
        outputs=dict(snakemake.output.items()),
    )
