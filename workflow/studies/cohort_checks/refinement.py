"""The outcome's own discretisation error beside that of the methods' mesh, by a finer mesh."""

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, read_tables
from pinnochio.mechanics.simulation import simulate
from pinnochio.tables.document import Block, Table, views
from pinnochio.virtual.ground_truth import NOMINAL, resolve
from pinnochio.virtual.outcome import Operation, meshed

FINER = 3  # nodes of the reference over those of the outcome
LARGEST_SHARE = 1 / 3  # of the methods' error that the outcome's own may be
METHODS, OUTCOME = "methods", "outcome"
CASE = (
    Column("case", str, "", "patient"),
    Column("mesh", str, "", "whose mesh"),
    Column("nodes", int, "", "its nodes"),
    Column("reference", int, "", "nodes of the finer mesh"),
    Column("mean", float, "mm", "mean distance from it on the judged face", ".4f"),
    Column("p95", float, "mm", "95th percentile", ".4f"),
    Column("seconds", float, "s", "time of the solution", ".1f"),
)
TABLE = (*CASE, Column("share", float, "%", "mean over that of the methods' mesh", ".1f"))


def measure(operation: Operation) -> list[dict]:
    """Rows of :data:`CASE` of one patient: the plan by nominal mechanics on the methods' mesh, on the outcome's and on
    one with :data:`FINER` times its nodes; both of these turned and shifted, each in its own way. Squeezed tissue
    yields as in the outcome, on all three: at bone that finds no room a finer mesh has no solution otherwise."""
    off, effects = resolve(NOMINAL), operation.settings.effects
    fem = replace(operation.settings.fem, yielding=effects["yielding"])
    nodes = effects["nodes"] or operation.settings.mesh["nodes"]
    elsewhere = replace(operation, seed=operation.seed + 1)
    models = {
        METHODS: meshed(operation, off),
        OUTCOME: meshed(operation, off | {"nodes": nodes}),
        "reference": meshed(elsewhere, off | {"nodes": FINER * nodes}),
    }
    places = models[METHODS].skin_points[models[METHODS].judged_points]
    index, fields = {name: model.skin_at(places) for name, model in models.items()}, {}
    shared = np.min(list(index.values()), axis=0) >= 0
    for name, model in models.items():
        (result,) = simulate(model, [operation.plan], fem)
        if not result.converged:
            raise RuntimeError(f"case {operation.case!r}, {len(model.points)} nodes: {result.reason}")
        moved = model.moved_skin(result.displacement) - model.skin_points
        fields[name] = moved[index[name][shared]], result.seconds
    finest, rows = fields["reference"][0], []
    for name in (METHODS, OUTCOME):
        field, seconds = fields[name]
        errors = np.linalg.norm(field - finest, axis=1)
        counts = {"nodes": len(models[name].points), "reference": len(models["reference"].points)}
        rows.append({"case": operation.case, "mesh": name, "mean": errors.mean(), "seconds": seconds,
                     "p95": np.percentile(errors, 95)} | counts)  # fmt: skip
    return rows


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns of :data:`TABLE`: the rows with the share that each error is of the methods'."""
    theirs = rows[rows["mesh"] == METHODS].set_index("case")["mean"]
    return check(rows.assign(share=100 * rows["mean"] / rows["case"].map(theirs)), TABLE)


def tabulate(rows: Sequence[str | os.PathLike], cohort: str) -> Table:
    """Both errors of every patient."""
    frame = summarise(read_tables(rows, CASE))
    headers = {"case": "Patient", "mesh": "Mesh", "nodes": "Nodes", "reference": "Finer mesh", "mean": "Mean mm"}
    view = views(TABLE, headers | {"p95": "p95 mm", "share": "Share %", "seconds": "Seconds"})
    caption = (
        f"Discretisation error on the judged face ({cohort}), the same nominal mechanics on the methods' mesh and on "
        "the outcome's: distance from a solution on a finer mesh, which itself has an error; wanted of the outcome is "
        f"a share below {100 * LARGEST_SHARE:.0f} %."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
