"""The table of time per stage, from the benchmark files of the study's jobs."""

import os
from functools import partial
from pathlib import Path

import pandas as pd

from pinnochio.columns import Column, check, number, read_csv
from pinnochio.errors import REMEDY, InputError
from pinnochio.tables.document import Block, Table, views

TOTAL = "all"
MEASURED = ["s", "cpu_time", "max_rss"]


_number = partial(number, form=".1f")


STAGES = (
    Column("rule", str, "", f"rule, whose job may run several stages, each timed in its log; {TOTAL}: the study"),
    Column("jobs", int, "", "jobs with a benchmark file"),
    _number("seconds", "s", "time of all jobs added up, also of parallel ones"),
    _number("mean", "s", "mean time of a job"),
    _number("longest", "s", "time of the longest job"),
    _number("cpu_seconds", "s", "processor time of all jobs"),
    _number("memory", "MB", "largest resident memory of a job", form=".0f"),
)


def read_benchmark(path: str | os.PathLike) -> pd.DataFrame:
    """Seconds s, processor seconds cpu_time and memory max_rss (MB) of each run in a benchmark file of Snakemake.

    NaN where it did not measure, as of jobs that were over too soon.
    """
    frame = read_csv(path, sep="\t", na_values=["NA", "-"], usecols=MEASURED, dtype=float)[MEASURED]
    if frame.empty:
        raise InputError("-", path, "it has no run", REMEDY)
    return frame


def stages(folder: str | os.PathLike) -> pd.DataFrame:
    """One row of STAGES per folder of benchmark files, the longest stage first, and the study as the last."""
    runs = [
        read_benchmark(path).assign(rule=path.relative_to(folder).parts[0])
        for path in sorted(Path(folder).glob("*/**/*.tsv"))
    ]
    runs = pd.concat(runs) if runs else pd.DataFrame(columns=[*MEASURED, "rule"])
    parts = {rule: part for rule, part in runs.groupby("rule")} | {TOTAL: runs}
    rows = [
        {
            "rule": rule,
            "jobs": len(part),
            "seconds": part["s"].sum(),
            "mean": part["s"].mean(),
            "longest": part["s"].max(),
            "cpu_seconds": part["cpu_time"].sum(),
            "memory": part["max_rss"].max(),
        }
        for rule, part in parts.items()
    ]
    frame = pd.DataFrame(rows)
    order = frame.assign(last=frame["rule"] == TOTAL).sort_values(
        ["last", "seconds", "rule"], ascending=[True, False, True]
    )
    return check(order.drop(columns="last"), STAGES)


def tabulate(benchmarks: str | os.PathLike, cohort: str) -> Table:
    """The files {rule}/*.tsv below the folder `benchmarks`, added up by rule."""
    frame = stages(benchmarks)
    headers = ("Rule", "Jobs", "Seconds", "Mean", "Longest", "CPU seconds", "Largest memory MB")
    view = views(STAGES, dict(zip((column.name for column in STAGES), headers, strict=True)))
    caption = (
        f"Time per rule of the study; {cohort}. Sums are over jobs, each at its last run: jobs that run side by side "
        "count in full, and rules whose jobs take about a second or less are not measured."
    )
    return Table(frame, STAGES, [Block.of(frame, view, caption)])
