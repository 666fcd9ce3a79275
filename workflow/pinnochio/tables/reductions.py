"""The table of scenes: what solving only what a plan requires costs on the face, and what it saves."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.tables.comparison import count
from pinnochio.tables.document import Block, Table, views

ERROR, SECONDS, RATIO = ".4f", ".2f", ".2f"
KEYS = ("method", "target", "plan")

TRIALS = (
    Column("case", str, "", "patient"),
    Column("method", str, "", "method of finite elements"),
    Column("target", int, "", "nodes that the mesher was asked for"),
    Column("plan", str, "", "which part of the patient's plan: lefort1, mandible, genioplasty, bimaxillary"),
    Column("model", str, "", "full: the whole patient is solved; auto: what the plan requires, where that is faster"),
    Column("seed", int, "", "seed of the study"),
    Column("code", str, "", "content hash of the code"),
    number("motion", "mm", "largest motion of the bone", ".3f"),
    Column("nodes", int, "", "nodes of the mesh"),
    number("share", "", "share of the cells that is solved", ".4f"),
    number("error_mean", "mm", "mean distance from the full model's displacement on the judged face", ERROR),
    number("error_max", "mm", "largest such distance", ERROR),
    number("decide_seconds", "s", "deciding what is solved", ".4f"),
    number("mesh_seconds", "s", "meshing and labelling", ".3f"),
    number("first_seconds", "s", "the first plan of the meshed patient, with what is made once", ".3f"),
    number("further_seconds", "s", "a further plan of the patient", ".3f"),
    Column("converged", bool, "", "whether the solver converged"),
)
SCENES = (
    Column("method", str, "", "method of finite elements"),
    Column("target", int, "", "nodes that the mesher was asked for"),
    Column("plan", str, "", "which part of the patients' plans"),
    Column("n", int, "", "patients"),
    Column("reduced", int, "", "patients of whom less than all is solved"),
    Column("failed", int, "", "patients whose solver did not converge, whole or reduced"),
    number("motion_mean", "mm", "mean of the largest motion of the bone", ".2f"),
    number("nodes_mean", "", "mean nodes of the mesh", ".0f"),
    number("share_mean", "", "mean share of the cells that is solved", ".3f"),
    number("error_mean", "mm", "mean over patients of the mean distance on the judged face", ERROR),
    number("error_mean_max", "mm", "largest mean distance of a patient", ERROR),
    number("error_max", "mm", "largest distance of any point of any patient", ERROR),
    number("decide_seconds", "s", "mean time to decide what is solved", ".3f"),
    number("full_further_seconds", "s", "mean time of a further plan of a patient, all solved", SECONDS),
    number("further_seconds", "s", "mean time of a further plan, reduced", SECONDS),
    number("further_ratio", "", "the first over the second", RATIO),
    number("full_first_seconds", "s", "mean time of the first plan of a meshed patient, all solved", SECONDS),
    number("first_seconds", "s", "mean time of the first plan of a meshed patient, reduced", SECONDS),
    number("first_ratio", "", "the first over the second", RATIO),
    number("full_whole_seconds", "s", "mean time from the imported patient to one plan's face, all solved", SECONDS),
    number("whole_seconds", "s", "mean time from the imported patient to one plan's face, reduced", SECONDS),
    number("whole_ratio", "", "the first over the second", RATIO),
    Column("pays", str, "", "for which plans the reduction is faster, end to end; not made: all is solved"),
)


def summarise(trials: pd.DataFrame) -> pd.DataFrame:
    """One row of SCENES per method, size and plan, in the order of first appearance, of the TRIALS of all patients."""
    rows = []
    for key, own in check(trials, TRIALS).groupby(list(KEYS), sort=False):
        full, auto = own[own["model"] == "full"], own[own["model"] == "auto"]
        row = dict(zip(KEYS, key, strict=True)) | {
            "n": len(auto),
            "reduced": int((auto["share"] < 1).sum()),
            "failed": own.loc[~own["converged"], "case"].nunique(),
            "motion_mean": auto["motion"].mean(),
            "nodes_mean": auto["nodes"].mean(),
            "share_mean": auto["share"].mean(),
            "error_mean": auto["error_mean"].mean(),
            "error_mean_max": auto["error_mean"].max(),
            "error_max": auto["error_max"].max(),
            "decide_seconds": auto["decide_seconds"].mean(),
        }
        for prefix, part in (("full_", full), ("", auto)):
            row[f"{prefix}further_seconds"] = part["further_seconds"].mean()
            row[f"{prefix}first_seconds"] = part["first_seconds"].mean()
            row[f"{prefix}whole_seconds"] = (part["mesh_seconds"] + part["first_seconds"]).mean()
        for name in ("further", "first", "whole"):
            row[f"{name}_ratio"] = row[f"full_{name}_seconds"] / row[f"{name}_seconds"]
        rows.append(row | {"pays": pays(row)})
    return check(pd.DataFrame(rows), SCENES)


def pays(row: dict) -> str:
    """For which plans the reduction of a row of SCENES is faster."""
    if not row["reduced"]:
        return "not made"
    names = {"one plan": "whole_ratio", "many plans": "further_ratio"}
    return ", ".join(name for name, ratio in names.items() if row[ratio] > 1) or "no"


def tabulate(trials: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The patients' trials averaged by method, size and plan, and in the twins one by one below."""
    single = check(read_tables(trials, TRIALS).sort_values("case", kind="stable"), TRIALS)
    frame = summarise(single)
    headers = {
        "method": "Method",
        "target": "Nodes",
        "plan": "Plan",
        "n": "Patients",
        "reduced": "reduced",
        "share_mean": "Share",
        "error_mean": "Error mm",
        "error_mean_max": "worst patient mm",
        "error_max": "worst point mm",
        "decide_seconds": "Decide s",
        "full_whole_seconds": "End to end, full s",
        "whole_seconds": "auto s",
        "whole_ratio": "times as fast",
        "full_first_seconds": "First plan, full s",
        "first_seconds": "auto s",
        "first_ratio": "times as fast",
        "full_further_seconds": "Further plan, full s",
        "further_seconds": "auto s",
        "further_ratio": "times as fast",
        "pays": "Pays for",
    }
    patients = single["case"].drop_duplicates()
    caption = (
        f"Solving only what a plan requires (auto) beside the whole patient (full), {cohort}, {count(frame['n'])} "
        f"patients ({', '.join(patients)}): means over those who have the plan. Reduced: patients of whom less than "
        "all is solved; share: of the cells, solved. Error: distance between the two displacements on the judged face: "
        "mean, that of the worst patient, that of the worst point. End to end: from the imported patient to the face "
        "of one plan, meshing and labelling with it; first plan: of the meshed patient, with what is made once; "
        "further plan: of the same patient. Seconds of the processor, one thread, same run."
    )
    single_headers = {
        "case": "Patient",
        "method": "Method",
        "target": "Nodes",
        "plan": "Plan",
        "model": "Model",
        "motion": "Motion mm",
        "share": "Share",
        "error_mean": "Error mm",
        "error_max": "worst point mm",
        "mesh_seconds": "Mesh s",
        "first_seconds": "First plan s",
        "further_seconds": "Further plan s",
        "converged": "Converged",
    }
    single_caption = f"The same, patient by patient, {cohort}."
    blocks = [
        Block.of(frame, views(SCENES, headers), caption),
        Block.of(single, views(TRIALS, single_headers), single_caption, "Patients"),
    ]
    return Table(frame, SCENES, blocks)
