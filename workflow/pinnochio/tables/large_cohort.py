"""What a large cohort would take on a cluster: arithmetic from what was measured on a small one."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pinnochio.tables.scaling_patients import patient_runs
from pinnochio.tables.stages import read_benchmark

# One after another, from the segmentation to the FEM samples.
CHAIN = ("import_segmentation", "tetrahedralize", "label_interfaces", "simulate_fem")
VIRTUAL = ("virtual_patient", "virtual_outcome", "virtual_postop_bones")
# One job per fold and method: of a length that the steps decide, or the patients.
TRAINING = ("pretrain", "finetune")
PATIENT_BY_PATIENT = ("predict", "evaluate")


@dataclass(frozen=True)
class Measured:
    """What the arithmetic starts from.

    benchmarks: folder of the jobs' benchmark files; cases: the patients; held_out: those of each fold; training: number
    of patients that each fold trains on; methods of the study; sizes: rows of SCALING; nodes of the study's meshes;
    megabytes: files per patient.
    """

    benchmarks: str | os.PathLike
    cases: Sequence[str]
    held_out: Mapping[str, Sequence[str]]
    training: Mapping[str, int]
    methods: Sequence[str]
    sizes: pd.DataFrame
    nodes: int
    megabytes: float

    def folds(self) -> pd.DataFrame:
        """Rule, fold, method, seconds and memory of the jobs that have a fold and a method."""
        rows = []
        for rule in (*TRAINING, *PATIENT_BY_PATIENT):
            for fold in self.held_out:
                for method in self.methods:
                    folder = "folds" if rule in PATIENT_BY_PATIENT else ""  # these also serve other arms and patients
                    path = Path(self.benchmarks, rule, folder, f"{fold}_{method}.tsv")
                    if path.exists():
                        run = read_benchmark(path).iloc[-1]
                        rows.append((rule, fold, method, run["s"], run["max_rss"]))
        return pd.DataFrame(rows, columns=["rule", "fold", "method", "seconds", "memory"])


def paragraphs(measured: Measured, patients: int, cohort: str) -> list[str]:
    """What `patients` of the kind that was measured would take, and what would limit it."""
    runs, folds = patient_runs(measured.benchmarks, measured.cases), measured.folds()
    title = (
        f"{patients:,} patients on a cluster, reckoned from the jobs of this study ({cohort}, n = "
        f"{len(measured.cases)}, {measured.nodes:,} nodes, {len(measured.held_out)} folds), not tried."
    )
    texts = [
        f"{title} {_work(runs, measured, patients)}",
        _jobs(runs, measured, patients),
        _training(folds, measured, patients),
        _folds(folds, measured, patients),
    ]
    return [text for text in texts if text]


def _work(runs: pd.DataFrame, measured: Measured, patients: int) -> str:
    stages = runs.groupby("stage")["seconds"].mean()
    virtual = stages[stages.index.isin(VIRTUAL)].sum()
    chain = runs[runs["stage"].isin(CHAIN)].groupby("case")["seconds"].sum()
    most = runs.loc[runs["memory"].idxmax()]
    making = f", {_time(virtual)} of it to make and operate on the virtual patient" if virtual else ""
    return (
        f"The stages of a patient take {_time(stages.sum())} of one core{making}: "
        f"{patients * stages.sum() / 3600:,.0f} core hours in all. Every core shortens this, because no patient waits "
        f"for another; the longest chain of one patient ({', '.join(CHAIN)}) takes {_time(chain.mean())} in the mean, "
        f"{_time(chain.max())} at most. The largest job of a patient holds {_data(most['memory'])} ({most['stage']}); "
        f"its files are {_data(measured.megabytes)}, those of all {_data(patients * measured.megabytes)}."
    )


def _jobs(runs: pd.DataFrame, measured: Measured, patients: int) -> str:
    each = runs["stage"].nunique()
    start = measured.sizes.loc[measured.sizes["unit"] == "job", "start_seconds"].mean()
    return (
        f"Jobs: {each} per patient, {each * patients:,} in all, of {runs['seconds'].mean():.1f} s in the mean, of "
        f"which {start:.1f} s go by until the process and its modules are there. Every second that a queue takes to "
        f"start a job is {each * patients / 3600:,.0f} h in all, unless the jobs of a patient are one group. One "
        "process plans and watches them all: docs/scaling.md says what that takes."
    )


def _training(folds: pd.DataFrame, measured: Measured, patients: int) -> str:
    trained = folds[folds["rule"].isin(TRAINING)]
    if trained.empty:
        return ""
    chains = trained.groupby(["method", "fold"])["seconds"].sum().groupby("method").mean()
    now, then = np.mean(list(measured.training.values())), patients * (1 - 1 / len(measured.held_out))
    text = (
        f"What more machines do not shorten: a fold is trained by one process, {_time(chains.max())} for "
        f"{chains.idxmax()}, whose steps are set. To show each of {then:,.0f} training patients as often as each of "
        f"{now:.0f} is shown now would take {_time(chains.max() * then / now)}."
    )
    each, method = _memory_of_patient(folds, measured)
    if not each > 0:
        return text
    return text + (
        f" That process holds all its patients at once, {each:.0f} MB each for {method} (pretraining on {now:.0f} less "
        f"pretraining on one): {_data(each * then)}. This breaks first: patients would have to be read as they are "
        "shown."
    )


def _folds(folds: pd.DataFrame, measured: Measured, patients: int) -> str:
    own = folds[folds["rule"].isin(PATIENT_BY_PATIENT)]
    if own.empty:
        return ""
    own = own.assign(each=own["seconds"] / own["fold"].map(lambda fold: len(measured.held_out[fold])))
    each = own.groupby(["rule", "method"])["each"].mean()
    rule, method = each.idxmax()
    share = patients / len(measured.held_out)
    return (
        f"Predictions and metrics are one job per fold and method, patient after patient: at most {each.max():.1f} s "
        f"for each ({rule} of {method}), {_time(each.max() * share)} for the {share:,.0f} patients of a fold, and "
        f"{each.sum() * patients / 3600:,.0f} core hours for all methods. More folds make these jobs shorter and the "
        "trainings more. No mesh is made before the last import is checked."
    )


def _memory_of_patient(folds: pd.DataFrame, measured: Measured) -> tuple[float, str]:
    """Memory in MB of each further training patient, and the method that it is largest with."""
    sizes = measured.sizes.assign(off=(measured.sizes["target"] - measured.nodes).abs()).sort_values("off")
    memories = []
    for (method, fold), own in folds[folds["rule"] == "pretrain"].groupby(["method", "fold"]):
        one = sizes.loc[sizes["stage"] == f"pretrain {method}", "memory"].dropna()
        others = measured.training[fold] - 1
        if len(one) and others and own["memory"].notna().all():
            memories.append(((own["memory"].max() - one.iloc[0]) / others, method))
    return max(memories, default=(np.nan, ""))


def _time(seconds: float) -> str:
    """Seconds, minutes, hours or days, to two or three digits."""
    for length, name in ((86400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {name}"
    return f"{seconds:.3g} s"


def _data(megabytes: float) -> str:
    """MB, GB or TB, to three digits."""
    for size, name in ((1e6, "TB"), (1e3, "GB")):
        if megabytes >= size:
            return f"{megabytes / size:.3g} {name}"
    return f"{megabytes:.3g} MB"
