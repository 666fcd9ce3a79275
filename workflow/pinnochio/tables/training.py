"""The table of the training of each learned method: size of its network, steps, samples, time."""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.tables.stages import read_benchmark
from pinnochio.training.checkpoint import load_tensors

# Section of the settings and folder of the benchmark files of each phase.
PHASES = {"pretraining": "pretrain", "finetuning": "finetune"}


_number = partial(number, form=".0f")


TRAINING = (
    Column("method", str, "", "learned method"),
    Column("parameters", int, "", "trained numbers of its network"),
    Column("folds", int, "", "folds, each with a network of its own"),
    *(
        column
        for phase in PHASES
        for column in (
            _number(f"{phase}_steps", "", f"optimisation steps of {phase}, at most"),
            _number(f"{phase}_samples", "", f"patients under a plan that {phase} sees: steps by batch"),
            _number(f"{phase}_validation", "", f"patients held back in {phase} to choose the weights"),
            _number(f"{phase}_patience", "", "looks without improvement after which it stops; 0: never"),
            _number(f"{phase}_seconds", "s", f"mean time of {phase} per fold, from its last start", form=".1f"),
        )
    ),
)
_TRAINING = {column.name: column for column in TRAINING}


def parameters(path: str | os.PathLike) -> int:
    """Trained numbers in a network's file: its floating-point tensors but for running statistics."""
    state = load_tensors(path, "cpu")["state"]
    return sum(
        value.numel()
        for name, value in state.items()
        if value.is_floating_point() and not name.split(".")[-1].startswith("running_")
    )


def budget(
    settings: Mapping[str, Mapping], networks: Mapping[str, Sequence[str]], folds: Sequence[str], benchmarks: str
) -> pd.DataFrame:
    """One row of TRAINING per method; settings: of the phases by method; networks: its files, fold by fold.

    benchmarks: folder of the jobs' benchmark files, {rule}/{fold}_{method}.tsv; what is not there leaves the time
    empty.
    """
    rows = []
    for method, phases in settings.items():
        row = {"method": method, "parameters": parameters(networks[method][0]), "folds": len(folds)}
        for phase, rule in PHASES.items():
            own = phases.get(phase) or {}
            row[f"{phase}_steps"] = own.get("steps", np.nan)
            row[f"{phase}_samples"] = own.get("steps", np.nan) * own.get("batch", 1)
            row |= {f"{phase}_{key}": own.get(key, np.nan) for key in ("validation", "patience")}
            row[f"{phase}_seconds"] = _mean_seconds([Path(benchmarks, rule, f"{fold}_{method}.tsv") for fold in folds])
        rows.append(row)
    return check(pd.DataFrame(rows), TRAINING)


def _mean_seconds(files: Sequence[Path]) -> float:
    seconds = [read_benchmark(file)["s"] for file in files if file.exists()]
    return float(pd.concat(seconds).mean()) if seconds else np.nan


def tabulate(
    networks: Sequence[str], settings: Mapping[str, Mapping], folds: Sequence[str], benchmarks: str, cohort: str
) -> Table:
    """The budget of settings by method; networks: every method's files, fold by fold."""
    files = {name: networks[i * len(folds) : (i + 1) * len(folds)] for i, name in enumerate(settings)}
    return table(budget(settings, files, folds, benchmarks), cohort)


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """The table of rows of TRAINING."""

    def both(key):
        names = [f"{phase}_{key}" for phase in PHASES]
        return lambda row: " + ".join(_TRAINING[name].text(row[name]) or "none" for name in names)

    view = [
        *views(TRAINING, {"method": "Method", "parameters": "Parameters"}),
        View("Steps", both("steps")),
        View("Samples", both("samples")),
        View("Seconds per fold", both("seconds")),
        View("Validation patients", both("validation")),
        View("Patience", both("patience")),
    ]
    caption = (
        f"Training of each learned method, {cohort}, {frame['folds'].max()} folds: pretraining + fine-tuning. A sample "
        "is one patient under one plan; seconds are of the machine that trained, from a job's last start."
    )
    return Table(frame, TRAINING, [Block.of(frame, view, caption)])
