"""The table of the inverse: how well the motion is found that made a face."""

import os
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import stats

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.plans.roles import known_role
from pinnochio.seeds import derive_seed
from pinnochio.tables.document import Block, Table, View, views
from studies.inverse.columns import RECOVERED, TASK, TASKS, TOLERANCE

ALL = "all"
INVERSES = (
    TASK,
    TOLERANCE,
    Column("bone", str, "", "maxilla, distal (lower jaw), mandible (uncut), proximal (ramus), chin, or all"),
    Column("patients", int, "", "patients"),
    Column("bones", int, "", "bones"),
    number("moved", "mm", "median motion of the bones", ".3f"),
    number("error", "mm", "median of the bones' mean distance from the true motion", ".4f"),
    number("error_low", "mm", "end of the bootstrap 95% interval of error", ".4f"),
    number("error_high", "mm", "end of the bootstrap 95% interval of error", ".4f"),
    number("error_worst", "mm", "largest error", ".4f"),
    number("degrees", "deg", "median angle from the true rotation", ".4f"),
    number("degrees_low", "deg", "end of the bootstrap 95% interval of degrees", ".4f"),
    number("degrees_high", "deg", "end of the bootstrap 95% interval of degrees", ".4f"),
    number("degrees_worst", "deg", "largest degrees", ".4f"),
    number("misfit", "mm", "median of what is left of the wish", ".3f"),
    number("seconds", "s", "median time of a proposal with its corrections", ".2f"),
)


def tabulate(recovered: Sequence[str | os.PathLike], cohort: str, seed: int) -> Table:
    """recovered: files of RECOVERED, one per patient."""
    frame = summarise(read_tables(recovered, RECOVERED), seed)
    by_name = {column.name: column for column in INVERSES}

    def spread(name: str):
        def text(row) -> str:
            middle, low, high, worst = (
                by_name[f"{name}{end}"].text(row[f"{name}{end}"]) for end in ("", "_low", "_high", "_worst")
            )
            return f"{middle} [{low}, {high}] ({worst})"

        return text

    first = {"task": "Wished", "tolerance": "Tolerance mm", "bone": "Bones", "patients": "Patients", "bones": "n"}
    view = [
        *views(INVERSES, first | {"moved": "Moved mm"}),
        View("Error mm", spread("error")),
        View("Error deg", spread("degrees")),
        *views(INVERSES, {"misfit": "Left mm", "seconds": "Seconds"}),
    ]
    caption = (
        f"From a wished face to the motion that made it, {cohort}: median [bootstrap 95 % interval over bones] "
        "(largest). Error: mean distance of a bone from where it went, and angle. Outcome: the scan after surgery, "
        "against the registered motion; it holds what no mechanics here knows. Landmarks: where those of the outcome "
        "are. Simulated: the finite-element face of the plan, its rami turning about their condyles, made by the mesh "
        "and mechanics that seek its motion: what can be found is found, no more. Proposed is the least motion of "
        "those that miss the wish by no more than the best one and the tolerance. Left: root mean square of the wish."
    )
    return Table(frame, INVERSES, [Block.of(frame, view, caption)])


def summarise(rows: pd.DataFrame, seed: int) -> pd.DataFrame:
    """One row of INVERSES per task, tolerance and kind of bone, and of all bones."""
    rows, results = rows.assign(bone=rows["segment"].map(known_role)), []
    for task in TASKS:
        for tolerance, group in rows[rows["task"] == task].groupby("tolerance"):
            for bone in (ALL, *dict.fromkeys(group["bone"])):
                part = group if bone == ALL else group[group["bone"] == bone]
                row = {"task": task, "tolerance": tolerance, "bone": bone}
                row |= {"patients": part["case"].nunique(), "bones": len(part)}
                row |= part[["moved", "error", "degrees", "misfit", "seconds"]].median().to_dict()
                for name in ("error", "degrees"):
                    low, high = _interval(part[name].to_numpy(float), derive_seed(seed, "inverse", f"{task} {bone}"))
                    row |= {f"{name}_low": low, f"{name}_high": high, f"{name}_worst": part[name].max()}
                results.append(row)
    return check(pd.DataFrame(results), INVERSES)


def _interval(values: np.ndarray, seed: int) -> tuple[float, float]:
    """95% bootstrap interval of the median."""
    if len(values) < 2:
        return np.nan, np.nan
    rng = np.random.default_rng(seed)
    resampled = stats.bootstrap((values,), np.median, n_resamples=2000, method="percentile", rng=rng)
    return float(resampled.confidence_interval.low), float(resampled.confidence_interval.high)
