"""The table of cost against the number of patients, from the benchmark files of the study's jobs."""

import itertools
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.statistics.growth import Growth, fit
from pinnochio.tables.document import Block, Table, views
from pinnochio.tables.stages import read_benchmark

_amount = partial(number, form=".1f")

PATIENTS = (
    Column("stage", str, "", "rule with a job for each patient"),
    Column("patients", int, "", "the first so many of the cohort"),
    _amount("seconds", "s", "time of their jobs together, with the start of each process"),
    _amount("mean", "s", "mean of a patient"),
    _amount("sd", "s", "standard deviation of a patient"),
    _amount("longest", "s", "longest of a patient"),
    _amount("memory", "MB", "largest resident memory of a job"),
)
# Rules of the study that have a job for each patient.
PATIENT_STAGES = (
    *("virtual_patient", "virtual_outcome", "virtual_postop_bones", "import_segmentation", "register_postop"),
    *("register_segments", "tetrahedralize", "label_interfaces", "choose_samples", "report_quality", "refine_lips"),
    *("simulate_fem", "make_lift"),
)


def patient_runs(folder: str | os.PathLike, cases: Sequence[str]) -> pd.DataFrame:
    """Stage, case, seconds and memory of the jobs of PATIENT_STAGES, stage by stage in the order of `cases`.

    Their benchmark files are {rule}/{case}.tsv, with further wildcards {rule}/{case}_{them}.tsv, of rules that serve
    others than the study's patients too below {rule}/cases or {rule}/virtual, and {case}/lips.tsv of the mesh for lips.
    """
    rows = []
    for rule, home in itertools.product(PATIENT_STAGES, ("", "cases", "virtual")):
        base = Path(folder, rule, home)
        for path in (*base.glob("*.tsv"), *base.glob("*/lips.tsv")):
            name = path.relative_to(base).with_suffix("").as_posix().replace("/", "_")
            own = [case for case in cases if name == case or name.startswith(f"{case}_")]
            if own:
                case = max(own, key=len)
                stage = f"{rule} {name[len(case) + 1 :]}".strip()
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
    return check(pd.DataFrame(rows, columns=[column.name for column in PATIENTS]), PATIENTS, "benchmark files")


def patient_growths(cohort: pd.DataFrame) -> dict[tuple[str, str, str], Growth]:
    """What is fitted to PATIENTS, by stage, "patients" and "seconds"."""
    return {
        (stage, "patients", "seconds"): fit(own["patients"], own["seconds"], constant=False)
        for stage, own in cohort.groupby("stage", sort=False)
    }


def tabulate(benchmarks: str | os.PathLike, cases: Sequence[str], counts: Sequence[int], cohort: str) -> Table:
    """The stages of the first patients, added up for each of the counts."""
    frame = patients(patient_runs(benchmarks, cases), counts)
    caption = f"Seconds of the stages that have a job for each patient, {cohort}, added up over the first patients."
    return Table(frame, PATIENTS, [Block.of(frame, views(PATIENTS), caption)])
