"""The table of cost against the nodes of the mesh; its twins hold the cost against the number of patients too."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pinnochio.columns import Column, number, read_tables
from pinnochio.files import megabytes
from pinnochio.statistics.growth import Growth, fit
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.tables.large_cohort import Measured, paragraphs
from pinnochio.tables.scaling_patients import PATIENTS, patient_growths, patient_runs, patients

SCALING = (
    Column("stage", str, "", "rule, and the method where it has one"),
    Column("unit", str, "", "what is counted: a job, a plan or a step of training"),
    Column("target", int, "", "nodes asked for"),
    number("nodes", "", "nodes of the mesh", ".0f"),
    number("seconds", "s", "one unit, without the start of its process"),
    number("cpu_seconds", "s", "processor time of it"),
    number("start_seconds", "s", "until the process and its modules were there"),
    number("memory", "MB", "peak resident memory of the process", ".1f"),
    number("written", "MB", "size of the files that it wrote", ".3f"),
    Column("outcome", str, "", "done, or why there is no number"),
)
QUANTITIES = ("seconds", "cpu_seconds", "memory")
ALONE = 0.8  # least share of a stage's time that the processor works if nothing else runs on the machine
_OF = {column.name: column for column in (*PATIENTS, *SCALING)}


def tabulate(
    sizes: Sequence[str | os.PathLike],
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
) -> Table:
    """The measured sizes, the sums over the first patients, and what a cohort of `cluster` patients would take.

    results, benchmarks: folders of the study; held_out: cases of each fold; training: how many each fold trains on;
    nodes: of the study's meshes; counts: how many patients are added up.
    """
    rows = read_sizes(sizes)
    counted = cases[: max(counts)]
    weight = sum(megabytes(Path(results, part, case)) for case in counted for part in ("virtual", "cases"))
    measured = Measured(benchmarks, cases, held_out, training, methods, rows, nodes, weight / len(counted))
    sums = patients(patient_runs(benchmarks, cases), counts)
    return table(rows, sums, cohort, paragraphs(measured, cluster, cohort))


def read_sizes(paths: Sequence[str | os.PathLike]) -> pd.DataFrame:
    """Rows of SCALING of several files, stage by stage, the smallest size first."""
    rows = read_tables(paths, SCALING)
    return pd.concat([own.sort_values("target") for _, own in rows.groupby("stage", sort=False)], ignore_index=True)


def size_growths(sizes: pd.DataFrame) -> dict[tuple[str, str, str], Growth]:
    """What is fitted to SCALING against nodes, by stage, "nodes" and quantity."""
    return {
        (stage, "nodes", quantity): fit(own["nodes"], own[quantity])
        for stage, own in sizes.groupby("stage", sort=False)
        for quantity in QUANTITIES
    }


def table(sizes: pd.DataFrame, sums: pd.DataFrame, cohort: str, paragraphs: Sequence[str] = ()) -> Table:
    """The table of rows of SCALING, in the twins with rows of PATIENTS and what is fitted to both.

    Below them stands which stage gave no number and why, and the paragraphs.
    """
    caption = (
        f"Cost of the stages against the nodes of the mesh; {cohort}, one patient, one OpenMP thread, every stage in a "
        "process of its own, whose start is not counted. Fitted: constant + c nodes^exponent, with the 95% interval of "
        "the exponent. A job writes files; a plan is solved by finite elements from rest, or predicted warm by a "
        "trained network; a step trains on one patient under one plan."
    )
    memory = f"Peak resident memory of a stage's process; {cohort}. The constant is mostly libraries."
    added = (
        f"Seconds of the stages that have a job for each patient, {cohort}, from the benchmark files of the study's "
        "jobs, with the start of each process: the first patients together, exponent of this sum with its 95% "
        "interval, mean ± standard deviation of a patient."
    )
    growths = size_growths(sizes) | patient_growths(sums)
    blocks = [
        Block.of(*_pivot(sizes, "seconds", growths), caption),
        Block.of(*_pivot(sizes, "memory", growths), memory, "Memory in MB"),
        Block.of(*_patients_view(sums, growths), added, "Patients"),
    ]
    failed = sizes[sizes["seconds"].isna()]
    said = [f"No number: {row.stage} at {row.target:,} nodes: {row.outcome}." for row in failed.itertuples()]
    shares = (sizes["cpu_seconds"] / sizes["seconds"]).dropna()
    if disturbed := int((shares < ALONE).sum()):
        said.append(
            f"Other work shared the machine: in {disturbed} of {len(shares)} measurements the processor worked less "
            f"than {ALONE:.0%} of the seconds, {shares.min():.0%} at least. Read the exponents of CPU seconds there."
        )
    return Table(sizes, SCALING, blocks, [*said, *paragraphs])


def _pivot(sizes: pd.DataFrame, quantity: str, growths: Mapping) -> tuple[pd.DataFrame, list[View]]:
    """One row per stage with a column for each size, and what is fitted."""

    def value(row, target):
        own = sizes[(sizes["stage"] == row["stage"]) & (sizes["target"] == target)]
        if own.empty:
            return ""
        return _OF[quantity].text(own[quantity].iloc[0]) or own["outcome"].iloc[0].split(":")[0]

    def growth(row):
        return growths[row["stage"], "nodes", quantity]

    view = [
        *views(SCALING, {"stage": "Stage", "unit": "Per"}),
        *(
            View(f"{target:,}", lambda row, target=target: value(row, target))
            for target in sorted(sizes["target"].unique())
        ),
        View("Constant", lambda row: _OF[quantity].text(growth(row).constant)),
        View("Exponent", lambda row: growth(row).text),
    ]
    if quantity == "seconds":
        view.append(View("of CPU seconds", lambda row: growths[row["stage"], "nodes", "cpu_seconds"].text))
    return sizes.drop_duplicates("stage")[["stage", "unit"]], view


def _patients_view(sums: pd.DataFrame, growths: Mapping) -> tuple[pd.DataFrame, list[View]]:
    def value(row, count):
        own = sums[(sums["stage"] == row["stage"]) & (sums["patients"] == count)]
        return "" if own.empty else _OF["mean"].text(own["seconds"].iloc[0])

    view = [
        *views(PATIENTS, {"stage": "Stage"}),
        *(
            View(f"{count:,} patients", lambda row, count=count: value(row, count))
            for count in sorted(sums["patients"].unique())
        ),
        View("Exponent", lambda row: growths[row["stage"], "patients", "seconds"].text),
        View("A patient", lambda row: f"{row['mean']:.1f} ± {row['sd']:.1f}"),
        *views(PATIENTS, {"longest": "Longest"}),
        View("Memory MB", lambda row: f"{row['memory']:.0f}"),
    ]
    last = sums.sort_values("patients").drop_duplicates("stage", keep="last")
    return last.sort_values("mean", ascending=False), view
