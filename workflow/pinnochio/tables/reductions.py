"""The table of model reductions: what each reduction of the model costs on the face, and what it saves."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.tables.comparison import count
from pinnochio.tables.document import Block, Table, views

ERROR = ".4f"

TRIALS = (
    Column("case", str, "", "patient"),
    Column("plan", str, "", "which part of the patient's plan: lefort1, mandible, genioplasty, bimaxillary"),
    Column("model", str, "", "full, full with one reduction, or auto: all reductions that the scene decides for"),
    Column("made", str, "", "reductions that were made", optional=True),
    Column("seed", int, "", "seed of the study"),
    Column("code", str, "", "content hash of the code"),
    number("motion", "mm", "largest motion of the bone", ".3f"),
    Column("nodes", int, "", "nodes of the mesh"),
    number("share", "", "nodes over those of the full model", ".4f"),
    number("error_mean", "mm", "mean distance from the full model's displacement on the judged face", ERROR),
    number("error_max", "mm", "largest such distance", ERROR),
    number("decide_seconds", "s", "deciding and reducing", ".3f"),
    number("mesh_seconds", "s", "meshing and labelling", ".3f"),
    number("solve_seconds", "s", "solving the plan", ".3f"),
    Column("converged", bool, "", "whether the solver converged"),
)
SCENES = (
    Column("plan", str, "", "which part of the patients' plans"),
    Column("model", str, "", "full, full with one reduction, or auto: all reductions that the scene decides for"),
    Column("n", int, "", "patients"),
    Column("failed", int, "", "patients whose solver did not converge"),
    number("motion_mean", "mm", "mean of the largest motion of the bone", ".2f"),
    number("nodes_mean", "", "mean nodes of the mesh", ".0f"),
    number("share_mean", "", "mean of the nodes over those of the full model", ".3f"),
    number("share_max", "", "largest of it", ".3f"),
    number("error_mean", "mm", "mean over patients of the mean distance on the judged face", ERROR),
    number("error_mean_max", "mm", "largest mean distance of a patient", ERROR),
    number("error_max", "mm", "largest distance of any point of any patient", ERROR),
    number("decide_seconds", "s", "mean time to decide and reduce", ".2f"),
    number("mesh_seconds", "s", "mean time to mesh and label", ".2f"),
    number("solve_seconds", "s", "mean time to solve", ".2f"),
)


def summarise(trials: pd.DataFrame) -> pd.DataFrame:
    """One row of SCENES per plan and model, in the order of first appearance, of the TRIALS of all patients."""
    rows = []
    for (plan, model), own in check(trials, TRIALS).groupby(["plan", "model"], sort=False):
        rows.append(
            {
                "plan": plan,
                "model": model,
                "n": len(own),
                "failed": int((~own["converged"]).sum()),
                "motion_mean": own["motion"].mean(),
                "nodes_mean": own["nodes"].mean(),
                "share_mean": own["share"].mean(),
                "share_max": own["share"].max(),
                "error_mean": own["error_mean"].mean(),
                "error_mean_max": own["error_mean"].max(),
                "error_max": own["error_max"].max(),
                **{name: own[name].mean() for name in ("decide_seconds", "mesh_seconds", "solve_seconds")},
            }
        )
    return check(pd.DataFrame(rows), SCENES)


def tabulate(trials: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The patients' trials averaged by plan and model, and in the twins one by one below."""
    single = check(read_tables(trials, TRIALS).sort_values("case", kind="stable"), TRIALS)
    frame = summarise(single)
    headers = {
        "plan": "Plan",
        "model": "Model",
        "motion_mean": "Motion mm",
        "nodes_mean": "Nodes",
        "share_mean": "Share of nodes",
        "share_max": "largest share",
        "error_mean": "Error mm",
        "error_mean_max": "worst patient mm",
        "error_max": "worst point mm",
        "decide_seconds": "Decide s",
        "mesh_seconds": "Mesh s",
        "solve_seconds": "Solve s",
    }
    patients = single["case"].drop_duplicates()
    caption = (
        f"Models reduced to what a plan requires, {cohort}, {count(frame['n'])} patients ({', '.join(patients)}): "
        "means over patients. Error: distance between the displacements of the reduced and the full model on the "
        "judged face: mean, that of the worst patient, that of the worst point. auto: all reductions that the scene "
        "decides for; the rows between: one reduction each. Mesh: meshing and labelling. One thread, same run."
    )
    single_headers = {
        "case": "Patient",
        "plan": "Plan",
        "model": "Model",
        "made": "Reductions",
        "motion": "Motion mm",
        "nodes": "Nodes",
        "share": "Share",
        "error_mean": "Error mm",
        "error_max": "worst point mm",
        "solve_seconds": "Solve s",
        "converged": "Converged",
    }
    single_caption = f"The same, patient by patient, {cohort}."
    blocks = [
        Block.of(frame, views(SCENES, headers), caption),
        Block.of(single, views(TRIALS, single_headers), single_caption, "Patients"),
    ]
    return Table(frame, SCENES, blocks)
