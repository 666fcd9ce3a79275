"""The table of the training of each learned method: size of its network, steps, samples, time, convergence."""

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
from pinnochio.training.convergence import Convergence, convergence

# Section of the settings and folder of the benchmark files of each phase.
PHASES = {"pretraining": "pretrain", "finetuning": "finetune"}


_number = partial(number, form=".0f")


TRAINING = (
    Column("method", str, "", "learned method"),
    Column("parameters", int, "", "parameters of its network"),
    Column("folds", int, "", "folds, each with its network"),
    *(
        column
        for phase in PHASES
        for column in (
            _number(f"{phase}_steps", "", f"optimisation steps of {phase}"),
            _number(f"{phase}_samples", "", f"samples in {phase}: steps by batch"),
            _number(f"{phase}_validation", "", f"patients held back in {phase} to choose the weights"),
            _number(f"{phase}_seconds", "s", f"mean time of {phase} per fold since its last start", form=".1f"),
            _number(f"{phase}_done", "", f"steps of {phase} done, least of the folds"),
            _number(f"{phase}_fall", "%", f"last fall of the least error in {phase}, median of the folds", form=".2f"),
            _number(f"{phase}_flat", "", f"folds with a flat curve in {phase}"),
            Column(
                f"{phase}_curve", str, "", f"patients of the curve of {phase}: held back or trained on", optional=True
            ),
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
    settings: Mapping[str, Mapping],
    networks: Mapping[str, Sequence[str]],
    folds: Sequence[str],
    benchmarks: str,
    histories: Mapping[tuple[str, str], Sequence[str]],
    rule: Mapping[str, float],
) -> pd.DataFrame:
    """One row of TRAINING per method; settings: of the phases by method; networks: its files, fold by fold.

    benchmarks: folder of the jobs' benchmark files, {rule}/{fold}_{method}.tsv; what is not there leaves the time
    empty. histories: the loss histories by method and phase, fold by fold; rule: `part` and `fall` of the convergence.
    """
    rows = []
    for method, phases in settings.items():
        row = {"method": method, "parameters": parameters(networks[method][0]), "folds": len(folds)}
        for phase, job in PHASES.items():
            section = phases.get(phase) or {}
            row[f"{phase}_steps"] = section.get("steps", np.nan)
            row[f"{phase}_samples"] = section.get("steps", np.nan) * section.get("batch", 1)
            row[f"{phase}_validation"] = section.get("validation", np.nan)
            row[f"{phase}_seconds"] = _mean_seconds([Path(benchmarks, job, f"{fold}_{method}.tsv") for fold in folds])
            ended = [convergence(path, rule["part"]) for path in histories.get((method, phase), [])]
            row |= {f"{phase}_{key}": value for key, value in _ended(ended, rule["fall"]).items()}
        rows.append(row)
    return check(pd.DataFrame(rows), TRAINING)


def _ended(folds: Sequence[Convergence], limit: float) -> dict:
    """What the folds' trainings have in common."""
    if not folds:
        return {"done": np.nan, "fall": np.nan, "flat": np.nan, "curve": ""}
    falls = [fold.fall for fold in folds if not np.isnan(fold.fall)]
    return {
        "done": min(fold.done for fold in folds),
        "fall": 100 * float(np.median(falls)) if falls else np.nan,
        "flat": sum(fold.flat(limit) for fold in folds),
        "curve": "held back" if all(fold.held_back for fold in folds) else "trained on",
    }


def _mean_seconds(files: Sequence[Path]) -> float:
    seconds = [read_benchmark(file)["s"] for file in files if file.exists()]
    return float(pd.concat(seconds).mean()) if seconds else np.nan


def tabulate(
    networks: Sequence[str],
    histories: Sequence[str],
    settings: Mapping[str, Mapping],
    folds: Sequence[str],
    benchmarks: str,
    rule: Mapping[str, float],
    cohort: str,
) -> Table:
    """The budget of settings by method; networks: every method's files, fold by fold; histories: every method's, phase
    by phase of those that its settings name, fold by fold; rule: of convergence."""
    files = {name: networks[i * len(folds) : (i + 1) * len(folds)] for i, name in enumerate(settings)}
    trained = [(name, phase) for name, phases in settings.items() for phase in PHASES if phases.get(phase)]
    curves = {key: histories[i * len(folds) : (i + 1) * len(folds)] for i, key in enumerate(trained)}
    return table(budget(settings, files, folds, benchmarks, curves, rule), cohort, rule)


def table(frame: pd.DataFrame, cohort: str, rule: Mapping[str, float]) -> Table:
    """The table of rows of TRAINING."""

    def both(text):
        return lambda row: " + ".join(text(row, phase) or "none" for phase in PHASES)

    def value(key):
        return both(lambda row, phase: _TRAINING[f"{phase}_{key}"].text(row[f"{phase}_{key}"]))

    def steps(row, phase):
        set_steps, done = (_TRAINING[f"{phase}_{key}"].text(row[f"{phase}_{key}"]) for key in ("steps", "done"))
        return set_steps if done in (set_steps, "") else f"{done} of {set_steps}"

    def flat(row, phase):
        folds, fall = (_TRAINING[f"{phase}_{key}"].text(row[f"{phase}_{key}"]) for key in ("flat", "fall"))
        mark = "*" if row[f"{phase}_curve"] == "trained on" else ""
        return f"{folds} ({fall or 'unknown'}{' %' if fall else ''}){mark}" if folds else ""

    view = [
        *views(TRAINING, {"method": "Method", "parameters": "Parameters"}),
        View("Steps", both(steps)),
        View("Samples", value("samples")),
        View("Seconds per fold", value("seconds")),
        View("Validation patients", value("validation")),
        View("Flat in folds (fall)", both(flat)),
    ]
    caption = (
        f"Training of each learned method, {cohort}, {frame['folds'].max()} folds: pretraining + fine-tuning. A sample "
        "is one patient under one plan; seconds are of the machine that trained, from a job's last start. Flat: over "
        f"the last {100 * rule['part']:g} % of its steps the least error of the patients held back fell by no more "
        f"than {100 * rule['fall']:g} %; in brackets the median fall. *: nobody is held back, and the curve is that of "
        "the patients trained on."
    )
    return Table(frame, TRAINING, [Block.of(frame, view, caption)])
