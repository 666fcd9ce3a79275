"""The table of what a finer mesh costs, by what each stage that makes it took."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.mechanics.lift import Lift
from pinnochio.model.patient import PatientModel
from pinnochio.stages import seconds_of
from pinnochio.tables.document import Block, Table, views
from scripts.patient.model_patient import RECORD

STAGES = {"mesh_case": "mesh", "label_case": "interfaces"}
SCALING = (
    Column("stage", str, "", "mesh, interfaces or lift"),
    Column("nodes", int, "", "nodes of the mesh"),
    number("seconds", "s", "time of the stage, without the start of its process", ".1f"),
)


def tabulate(models: Sequence[str], lifts: Sequence[str], cohort: str) -> Table:
    """models, lifts: files of one patient on each mesh, in one order."""
    rows = []
    for model, lift in zip(models, lifts, strict=True):
        nodes, took = len(PatientModel.read(model).points), seconds_of(Path(model).with_name(RECORD))
        seconds = {words: took[name] for name, words in STAGES.items()} | {"lift": Lift.read(lift).seconds}
        rows += [{"stage": stage, "nodes": nodes, "seconds": value} for stage, value in seconds.items()]
    frame = check(pd.DataFrame(rows), SCALING).sort_values(["stage", "nodes"], ignore_index=True)
    view = views(SCALING, dict(zip((column.name for column in SCALING), ("Stage", "Nodes", "Seconds"), strict=True)))
    caption = f"What a finer mesh costs, one patient, {cohort}; jobs that run side by side lengthen each other."
    return Table(frame, SCALING, [Block.of(frame, view, caption)])
