"""How far off sliding finite elements with the true motion are, at each scale of the changes; and the scale wanted."""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number, read_tables, words
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.mechanics.simulation import simulate
from pinnochio.metrics.chamfer import surface_metrics
from pinnochio.metrics.judged import choose
from pinnochio.metrics.region_errors import REGIONS, region_errors
from pinnochio.plans.plan import Plan
from pinnochio.seeds import generator
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.covariates import sample_covariates
from pinnochio.virtual.ground_truth import NOMINAL, REALITIES, in_reality, resolve
from pinnochio.virtual.outcome import Operation, Outcome, change, changed, meshed, moved, photograph

SCALES = (0.5, 1.0, 1.5, 2.0)
MEASURED = ("cd", "pwr2", "p90", *REGIONS)
CASE = (
    Column("case", str, "", "patient of the calibration"),
    Column("reality", str, "", "setting of the outcome"),
    Column("scale", float, "1", "scale of the changes", ".2f"),
    Column("cd", float, "mm", "mean distance of sliding finite elements with the true motion", ".4f"),
    Column("pwr2", float, "%", "judged skin nearer than 2 mm", ".2f"),
    Column("p90", float, "mm", "90th percentile of the distance from the scan", ".3f"),
    *(number(name, "mm", f"mean distance, {words(name)}", ".3f") for name in REGIONS),
)
PARTS = ("nose", "upper_lip", "lower_lip", "chin", "cheeks")
TABLE = (
    Column("reality", str, "", "setting of the outcome"),
    Column("what", str, "", "ours, or what is aimed at"),
    number("scale", "1", "scale of the changes at which ours has the mean distance aimed at", ".2f"),
    Column("n", int, "", "patients"),
    Column("cd", float, "mm", "mean distance of sliding finite elements with the true motion", ".3f"),
    Column("sd", float, "mm", "standard deviation over the patients", ".3f"),
    number("pwr2", "%", "judged skin nearer than 2 mm", ".1f"),
    number("p90", "mm", "90th percentile of the distance", ".2f"),
    *(number(name, "mm", f"mean distance, {words(name)}", ".2f") for name in PARTS),
)
# Mean, SD, share below 2 mm, 90th percentile, then the regions [S], [D] where only a budget says so.
AIMS = {
    "clinic": (1.30, 0.30, 80.0, np.nan, 0.9, 1.3, 1.8, 1.4, 1.3),
    "same_modality": (0.95, 0.30, np.nan, 1.9, 0.65, 1.0, 1.25, 1.05, 0.95),
}


def measure(operation: Operation, effects: dict[str, Any] | str, samples: int) -> list[dict]:
    """Rows of :data:`CASE` of one patient at every scale of :data:`SCALES` in every reality, and on `nominal`.

    effects: section of the configuration; samples: of the mean distance, as in the evaluation. The patient has the
    covariates that the reality gives it, and each scan is registered anew.
    """
    case, fem = operation.case, operation.settings.fem
    coarse = meshed(operation, resolve(NOMINAL))
    fine, rows, predicted = None, [], None

    def row(reality: str, scale: float, executed: Plan, predicted, scan) -> dict:
        target = operation.registered(scan)
        judged = choose(coarse, executed, *target, samples, operation.seed)
        carried = judged.carried(coarse, predicted)
        metrics = surface_metrics(predicted, coarse.skin_faces, carried, *target, judged.target)
        outside = -signed_distances(judged.target, predicted, coarse.skin_faces)
        errors = region_errors(judged.target_region, outside)
        p90 = float(np.percentile(np.abs(outside), 90))
        regions = {name: errors[f"region_{name}"] for name in REGIONS}
        return {"case": case, "reality": reality, "scale": scale, "p90": p90} | regions | {
            name: metrics[name] for name in ("cd", "pwr2")
        }  # fmt: skip

    for reality in REALITIES:
        values = in_reality(effects, reality)
        draws = generator(operation.seed, "sample_covariates", case)
        operation = replace(operation, covariates=sample_covariates(operation.anatomy, reality, draws))
        fine = fine or meshed(operation, values)
        base = moved(operation, values, fine)
        field = change(operation, values, base)
        sliding = simulate(coarse, [base.executed], fem)[0].displacement
        predicted = coarse.moved_skin(sliding)
        for scale in SCALES:
            seen = photograph(operation, changed(base, scale * field), values, scale)
            rows.append(row(reality, scale, base.executed, predicted, seen))
    plain = in_reality(effects, NOMINAL)
    seen = photograph(operation, Outcome(coarse, sliding, base.executed), plain)
    rows.append(row(NOMINAL, 0.0, base.executed, predicted, seen))
    return rows


def scale_for(rows: pd.DataFrame, target: float) -> float:
    """Scale at which the mean of `cd` over the patients is the target, between the scales measured; the nearest end
    where none is."""
    means = rows.groupby("scale")["cd"].mean()
    return float(np.interp(target, means.to_numpy(), means.index.to_numpy()))


def at_scale(rows: pd.DataFrame, scale: float) -> pd.DataFrame:
    """One row per patient of what was measured, interpolated to a scale."""
    patients = {}
    for case, patient in rows.sort_values("scale").groupby("case"):
        patients[case] = {name: np.interp(scale, patient["scale"], patient[name]) for name in MEASURED}
    frame = pd.DataFrame.from_dict(patients, orient="index")
    frame["cheeks"] = frame[["cheek_left", "cheek_right"]].mean(axis=1)
    return frame


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns of :data:`TABLE`: for each reality ours at the scale found and the aim; then `nominal`."""
    entries = []
    for reality in (*REALITIES, NOMINAL):
        group = rows[rows["reality"] == reality]
        scale = scale_for(group, REALITIES[reality].target) if reality in REALITIES else 0.0
        patients = at_scale(group, scale)
        entry = {"reality": reality, "what": "ours", "scale": scale, "n": len(patients)}
        means = patients[["cd", "pwr2", "p90", *PARTS]].mean()
        entries.append(entry | dict(means) | {"sd": patients["cd"].std(ddof=min(1, len(patients) - 1))})
        if reality in AIMS:
            numbers = dict(zip(("cd", "sd", "pwr2", "p90", *PARTS), AIMS[reality], strict=True))
            entries.append({"reality": reality, "what": "aim", "scale": np.nan, "n": len(patients)} | numbers)
    return check(pd.DataFrame(entries), TABLE)


def tabulate(rows: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The scale of each reality, and what sliding finite elements have there beside what is aimed at."""
    frame = summarise(read_tables(rows, CASE))
    view = [
        *views(TABLE, {"reality": "Reality", "what": "What", "scale": "Scale"}),
        View("Mean distance mm", lambda row: f"{row['cd']:.2f} ± {row['sd']:.2f}"),
        *views(TABLE, {"pwr2": "Below 2 mm %", "p90": "p90 mm"} | {name: words(name) for name in PARTS}),
    ]
    caption = (
        f"Sliding finite elements with the true motion of the bones on {frame['n'].max()} calibration patients "
        f"({cohort}, seeds of its own) at the scale of the changes where the mean distance is that of the "
        "literature; below it what is aimed at: whole face, lower lip, chin and nose sourced, the other regions a "
        "budget. Nominal: the noise floor."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
