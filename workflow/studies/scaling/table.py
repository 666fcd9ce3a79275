"""The table of what a finer mesh costs, from the benchmark files of the stages that make it."""

import os
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.model.patient import PatientModel
from pinnochio.tables.document import Block, Table, views
from pinnochio.tables.stages import read_benchmark

STAGES = ("tetrahedralize", "label_interfaces", "make_lift")
SCALING = (
    Column("stage", str, "", "rule"),
    Column("nodes", int, "", "nodes of the mesh"),
    number("seconds", "s", "time of the job, start of its process included", ".1f"),
    number("cpu_seconds", "s", "processor time of the job", ".1f"),
    number("memory", "MB", "largest resident memory", ".0f"),
)


def tabulate(models: Sequence[str], benchmarks: str | os.PathLike, cohort: str) -> Table:
    """models: files of one patient's models, below results/, which its jobs' benchmark files repeat."""
    rows = []
    for path in map(Path, models):
        mesh = path.parent.relative_to(Path(benchmarks).parent)
        nodes = len(PatientModel.read(path).points)
        for stage in STAGES:
            for file in sorted(Path(benchmarks, stage, mesh.parent).glob(f"{mesh.name}*.tsv")):
                if file.stem.removeprefix(mesh.name) in ("", "_elastic"):
                    run = read_benchmark(file).iloc[-1]
                    measured = {"seconds": run["s"], "cpu_seconds": run["cpu_time"], "memory": run["max_rss"]}
                    rows.append({"stage": stage, "nodes": nodes} | measured)
    frame = check(pd.DataFrame(rows), SCALING).sort_values(["stage", "nodes"], ignore_index=True)
    headers = ("Stage", "Nodes", "Seconds", "CPU seconds", "Largest memory MB")
    view = views(SCALING, dict(zip((column.name for column in SCALING), headers, strict=True)))
    caption = f"What a finer mesh costs, one patient, {cohort}; jobs that run side by side lengthen each other."
    return Table(frame, SCALING, [Block.of(frame, view, caption)])
