"""The tables of scaling: what each stage costs against the nodes of the mesh and against the number of patients."""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pinnochio.experiments.measuring import DONE
from pinnochio.statistics.growth import Growth, fit
from pinnochio.tables.cost import read_benchmark
from pinnochio.tables.engine import Block, Column, View, number, write_csv, write_twins

_amount = partial(number, form=".1f")

SCALING = (
    Column("stage", str, "", "rule, and the method where it has one"),
    Column("unit", str, "", "what is counted: a job, a plan or a step of training"),
    Column("target", int, "", "nodes asked for"),
    number("nodes", "", "nodes of the mesh", ".0f"),
    number("seconds", "s", "one unit, without the start of its process"),
    number("cpu_seconds", "s", "processor time of it"),
    number("start_seconds", "s", "until the process and its modules were there"),
    _amount("memory", "MB", "the most that the process held"),
    number("written", "MB", "size of the files that it wrote", ".3f"),
    Column("outcome", str, "", f"{DONE}, or why there is no number"),
)
PATIENTS = (
    Column("stage", str, "", "rule with a job for each patient"),
    Column("patients", int, "", "the first so many of the cohort"),
    _amount("seconds", "s", "time of their jobs together, with the start of each process"),
    _amount("mean", "s", "mean of a patient"),
    _amount("sd", "s", "standard deviation of a patient"),
    _amount("longest", "s", "longest of a patient"),
    _amount("memory", "MB", "largest resident memory of a job"),
)
EXPONENTS = (
    Column("stage", str, "", "as in the other tables"),
    Column("against", str, "", "nodes or patients"),
    Column("quantity", str, "", "seconds, cpu_seconds or memory"),
    Column("points", int, "", "sizes that were measured"),
    number("largest", "", "largest of them", ".0f"),
    number("constant", "s or MB", "what does not grow"),
    number("growing", "s or MB", "what grows, at the largest size, as (size / largest) to the exponent"),
    number("exponent", "", "exponent of what grows"),
    number("error", "", "half-width of its 95% interval"),
)
QUANTITIES = ("seconds", "cpu_seconds", "memory")
ALONE = 0.8  # least share of a stage's time that the processor works if nothing else runs on the machine
# Rules of the study that have a job for each patient.
PATIENT_STAGES = (
    *("virtual_patient", "virtual_outcome", "import_segmentation", "register_postop", "tetrahedralize"),
    *("label_interfaces", "report_quality", "refine_lips", "label_lips", "simulate_fem", "make_lift"),
)
_OF = {column.name: column for column in (*PATIENTS, *SCALING)}


def patient_runs(folder: str | os.PathLike, cases: Sequence[str]) -> pd.DataFrame:
    """Stage, case, seconds and memory of the jobs of PATIENT_STAGES, stage by stage in the order of `cases`.

    Their benchmark files are {rule}/{case}.tsv or, of a rule with further wildcards, {rule}/{case}_{them}.tsv.
    """
    rows = []
    for rule in PATIENT_STAGES:
        for path in Path(folder, rule).glob("*.tsv"):
            own = [case for case in cases if path.stem == case or path.stem.startswith(f"{case}_")]
            if own:
                case = max(own, key=len)
                stage = f"{rule} {path.stem[len(case) + 1 :]}".strip()
                run = read_benchmark(path).iloc[-1]
                place = PATIENT_STAGES.index(rule), stage, cases.index(case)
                rows.append((place, stage, case, run["s"], run["max_rss"]))
    return pd.DataFrame([row[1:] for row in sorted(rows)], columns=["stage", "case", "seconds", "memory"])


def patients(runs: pd.DataFrame, counts: Sequence[int]) -> pd.DataFrame:
    """One row of PATIENTS per stage of patient_runs and number of patients that it has been run on."""
    rows = []
    for stage, own in runs.groupby("stage", sort=False):
        for count in counts:
            if count <= len(own):
                first = own.iloc[:count]
                seconds = first["seconds"]
                row = {"stage": stage, "patients": count, "seconds": seconds.sum(), "mean": seconds.mean()}
                row |= {"sd": seconds.std(), "longest": seconds.max(), "memory": first["memory"].max()}
                rows.append(row)
    return pd.DataFrame(rows, columns=[column.name for column in PATIENTS])


def size_growths(sizes: pd.DataFrame) -> dict[tuple[str, str, str], Growth]:
    """What is fitted to SCALING against nodes, by stage, "nodes" and quantity."""
    return {
        (stage, "nodes", quantity): fit(own["nodes"], own[quantity])
        for stage, own in sizes.groupby("stage", sort=False)
        for quantity in QUANTITIES
    }


def patient_growths(cohort: pd.DataFrame) -> dict[tuple[str, str, str], Growth]:
    """The same of PATIENTS, by stage, "patients" and "seconds"."""
    return {
        (stage, "patients", "seconds"): fit(own["patients"], own["seconds"], constant=False)
        for stage, own in cohort.groupby("stage", sort=False)
    }


def write_scaling(
    sizes: pd.DataFrame,
    cohort: pd.DataFrame,
    paths: Mapping[str, str | os.PathLike],
    name: str = "virtual cohort",
    paragraphs: Sequence[str] = (),
) -> None:
    """Write the CSV files `scaling`, `patients`, `exponents` of SCALING and PATIENTS, and the twins of the first.

    The twins hold them all, and below them which stage gave no number and why, and the paragraphs.
    """
    sizes, cohort = write_csv(sizes, paths["scaling"], SCALING), write_csv(cohort, paths["patients"], PATIENTS)
    grown = size_growths(sizes) | patient_growths(cohort)
    rows = [dict(zip(("stage", "against", "quantity"), key, strict=True)) | vars(g) for key, g in grown.items()]
    write_csv(pd.DataFrame(rows), paths["exponents"], EXPONENTS)
    caption = (
        f"Cost of the stages against the nodes of the mesh; {name}, one patient, one OpenMP thread, every stage in a "
        "process of its own, whose start is not counted. Fitted: constant + c nodes^exponent, with the 95% interval of "
        "the exponent. A job writes files; a plan is solved by finite elements from rest, or predicted warm by a "
        "trained network; a step trains on one patient under one plan."
    )
    memory = f"The most that the process of a stage held; {name}. The constant is mostly libraries."
    added = (
        f"Seconds of the stages that have a job for each patient, {name}, from the benchmark files of the study's "
        "jobs, with the start of each process: the first patients together, exponent of this sum with its 95% "
        "interval, mean ± standard deviation of a patient."
    )
    further = [
        Block(*_pivot(sizes, "memory", grown), memory, "Memory in MB"),
        Block(*_cohort_view(cohort, grown), added, "Patients"),
    ]
    failed = sizes[sizes["outcome"] != DONE]
    said = [f"No number: {row.stage} at {row.target:,} nodes: {row.outcome}." for row in failed.itertuples()]
    shares = (sizes["cpu_seconds"] / sizes["seconds"]).dropna()
    if disturbed := int((shares < ALONE).sum()):
        said.append(
            f"Other work shared the machine: in {disturbed} of {len(shares)} measurements the processor worked less "
            f"than {ALONE:.0%} of the seconds, {shares.min():.0%} at least. Read the exponents of CPU seconds there."
        )
    frame, view = _pivot(sizes, "seconds", grown)
    write_twins(frame, paths["scaling"], view, caption, SCALING, further, [*said, *paragraphs])


def exponent(growth: Growth) -> str:
    """An exponent with its interval; empty where there is none."""
    if np.isnan(growth.exponent):
        return ""
    return f"{growth.exponent:.2f}" + ("" if np.isnan(growth.error) else f" ± {growth.error:.2f}")


def _pivot(sizes: pd.DataFrame, quantity: str, grown: Mapping) -> tuple[pd.DataFrame, list[View]]:
    """One row per stage with a column for each size, and what is fitted."""

    def value(row, target):
        own = sizes[(sizes["stage"] == row["stage"]) & (sizes["target"] == target)]
        if own.empty:
            return ""
        return _OF[quantity].text(own[quantity].iloc[0]) or own["outcome"].iloc[0].split(":")[0]

    def growth(row):
        return grown[row["stage"], "nodes", quantity]

    view = [
        View("Stage", lambda row: row["stage"]),
        View("Per", lambda row: row["unit"]),
        *(
            View(f"{target:,}", lambda row, target=target: value(row, target))
            for target in sorted(sizes["target"].unique())
        ),
        View("Constant", lambda row: _OF[quantity].text(growth(row).constant)),
        View("Exponent", lambda row: exponent(growth(row))),
    ]
    if quantity == "seconds":
        view.append(View("of CPU seconds", lambda row: exponent(grown[row["stage"], "nodes", "cpu_seconds"])))
    return sizes.drop_duplicates("stage")[["stage", "unit"]], view


def _cohort_view(cohort: pd.DataFrame, grown: Mapping) -> tuple[pd.DataFrame, list[View]]:
    def value(row, count):
        own = cohort[(cohort["stage"] == row["stage"]) & (cohort["patients"] == count)]
        return "" if own.empty else _OF["mean"].text(own["seconds"].iloc[0])

    view = [
        View("Stage", lambda row: row["stage"]),
        *(
            View(f"{count:,} patients", lambda row, count=count: value(row, count))
            for count in sorted(cohort["patients"].unique())
        ),
        View("Exponent", lambda row: exponent(grown[row["stage"], "patients", "seconds"])),
        View("A patient", lambda row: f"{row['mean']:.1f} ± {row['sd']:.1f}"),
        View("Longest", lambda row: _OF["longest"].text(row["longest"])),
        View("Memory MB", lambda row: f"{row['memory']:.0f}"),
    ]
    last = cohort.sort_values("patients").drop_duplicates("stage", keep="last")
    return last.sort_values("mean", ascending=False), view
