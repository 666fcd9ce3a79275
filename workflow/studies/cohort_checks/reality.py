"""The dials of each reality: at which finite elements are as far off, and as much can be learned, as is aimed at."""

import os
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import least_squares

from pinnochio.columns import Column, check, number, read_tables, words
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.geometry.interpolation import interpolate
from pinnochio.mechanics.simulation import simulate
from pinnochio.metrics.chamfer import surface_metrics
from pinnochio.metrics.judged import choose
from pinnochio.metrics.region_errors import REGIONS, region_errors
from pinnochio.seeds import generator
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.covariates import sample_covariates
from pinnochio.virtual.ground_truth import CLINIC, NOMINAL, REALITIES, SAME_MODALITY, Dials, in_reality, resolve
from pinnochio.virtual.outcome import Operation, after, change, meshed, moved, photograph

# Values of the dials that are measured.
DECIDED, OPEN = (0.0, 1.0, 2.5), {CLINIC: (1.0, 1.6, 2.2), SAME_MODALITY: (0.5, 1.0, 1.6)}
MEASURED = ("cd", "cd_learner", "cd_floor", "pwr2", "p90", *REGIONS)
CASE = (
    Column("case", str, "", "patient of the calibration"),
    Column("reality", str, "", "setting of the outcome"),
    Column("decided", float, "1", "dial of what is decided", ".2f"),
    Column("open", float, "1", "dial of what is open", ".2f"),
    Column("cd", float, "mm", "mean distance of sliding finite elements with the true motion", ".4f"),
    Column("cd_learner", float, "mm", "mean distance of what is decided", ".4f"),
    Column("cd_floor", float, "mm", "mean distance of the true skin from its own scan", ".4f"),
    Column("pwr2", float, "%", "judged skin nearer than 2 mm to finite elements", ".2f"),
    Column("p90", float, "mm", "90th percentile of their distance from the scan", ".3f"),
    *(number(name, "mm", f"their mean distance, {words(name)}", ".3f") for name in REGIONS),
)
PARTS = ("nose", "upper_lip", "lower_lip", "chin", "cheeks")
TABLE = (
    Column("reality", str, "", "setting of the outcome"),
    Column("what", str, "", "ours, or what is aimed at"),
    number("share", "%", "of the square of the mean distance that is decided", ".1f"),
    number("decided", "1", "dial of what is decided", ".2f"),
    number("open", "1", "dial of what is open", ".2f"),
    Column("n", int, "", "patients"),
    Column("cd", float, "mm", "mean distance of sliding finite elements with the true motion", ".3f"),
    Column("sd", float, "mm", "standard deviation over the patients", ".3f"),
    number("floor", "mm", "mean distance of the true skin from its own scan", ".3f"),
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
    """Rows of :data:`CASE` of one patient at all values of the dials in every reality.

    effects: section of the configuration; samples: of the mean distance, as in the evaluation. The patient has the
    covariates that the reality gives it, and each scan is registered anew.
    """
    case, rows = operation.case, []
    coarse, fine = meshed(operation, resolve(NOMINAL)), None
    for reality in REALITIES:
        values = in_reality(effects, reality)
        draws = generator(operation.seed, "sample_covariates", case)
        operation = replace(operation, covariates=sample_covariates(operation.anatomy, reality, draws))
        if fine is None:  # neither meshes nor mechanics differ between the realities
            fine = meshed(operation, values)
            base = moved(operation, values, fine)
            sliding = simulate(coarse, [base.executed], operation.settings.fem)[0].displacement
            predicted = coarse.moved_skin(sliding)
        changes = change(operation, values, base)
        for decided, opened in product(DECIDED, OPEN[reality]):
            outcome = after(base, changes, Dials(decided, opened))
            target = operation.registered(photograph(operation, outcome, values))
            judged = choose(coarse, base.executed, *target, samples, operation.seed)
            known = (
                coarse.skin_points + interpolate(coarse.skin_points, fine.points, fine.cells, field)
                for field in (outcome.expected, outcome.displacement)
            )
            metrics, learner, floor = (
                surface_metrics(skin, coarse.skin_faces, judged.before(coarse).carried(skin), *target, judged.target)
                for skin in (predicted, *known)
            )
            outside = -signed_distances(judged.target, predicted, coarse.skin_faces)
            errors = region_errors(judged.target_region, outside)
            row = {"case": case, "reality": reality, "decided": decided, "open": opened}
            row |= {"cd": metrics["cd"], "cd_learner": learner["cd"], "cd_floor": floor["cd"]}
            row |= {"pwr2": metrics["pwr2"], "p90": float(np.percentile(np.abs(outside), 90))}
            rows.append(row | {name: errors[f"region_{name}"] for name in REGIONS})
    return rows


class Surface:
    """What was measured, between the dials' values: linear in both."""

    def __init__(self, rows: pd.DataFrame):
        rows = rows.sort_values(["decided", "open"])
        grid = [np.unique(rows[name]) for name in ("decided", "open")]
        self.bounds = tuple(np.array([[axis[0], axis[-1]] for axis in grid]).T)
        shape = [len(axis) for axis in grid]
        self.of = {name: RegularGridInterpolator(grid, rows[name].to_numpy().reshape(shape)) for name in MEASURED}

    def __call__(self, dials: Dials) -> dict[str, float]:
        return {name: value(dials).item() for name, value in self.of.items()}


def share(numbers: dict[str, float]) -> float:
    """Percent of the square of the mean distance that is decided."""
    return 100 * (1 - (numbers["cd_learner"] / numbers["cd"]) ** 2)


def dials_for(rows: pd.DataFrame, target: float, wanted: float) -> Dials:
    """Dials at which the mean of `cd` over the patients is the target and the share (%) the wanted one; the nearest
    that were measured where none are."""
    means = Surface(rows.groupby(["decided", "open"], as_index=False)[list(MEASURED)].mean())

    def misfit(values) -> list[float]:
        numbers = means(Dials(*values))
        return [10 * (numbers["cd"] - target), (share(numbers) - wanted) / 10]

    low, high = means.bounds
    starts = [low + part * (high - low) for part in (0.25, 0.5, 0.75)]
    fit = min((least_squares(misfit, start, bounds=(low, high)) for start in starts), key=lambda one: one.cost)
    return Dials(*(float(np.round(value, 2)) for value in fit.x))


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns of :data:`TABLE`: for each reality ours at the dials of every share, and the aim."""
    entries = []
    for reality, known in REALITIES.items():
        group = rows[rows["reality"] == reality]
        for wanted in known.dials:
            dials = dials_for(group, known.target, wanted)
            patients = pd.DataFrame([Surface(patient)(dials) for _, patient in group.groupby("case")])
            patients["cheeks"] = patients[["cheek_left", "cheek_right"]].mean(axis=1)
            means = dict(patients.mean())
            entry = {"reality": reality, "what": "ours", "share": share(means), "decided": dials.decided}
            entry |= {"open": dials.open, "n": len(patients), "sd": patients["cd"].std(ddof=min(1, len(patients) - 1))}
            entry |= {name: means[name] for name in ("cd", "pwr2", "p90", *PARTS)} | {"floor": means["cd_floor"]}
            entries.append(entry)
        numbers = dict(zip(("cd", "sd", "pwr2", "p90", *PARTS), AIMS[reality], strict=True))
        entries.append({"reality": reality, "what": "aim", "n": len(patients)} | numbers)
    frame = pd.DataFrame(entries).reindex(columns=[column.name for column in TABLE])
    return check(frame, TABLE)


def tabulate(rows: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The dials of each reality, and what sliding finite elements have there beside what is aimed at."""
    frame = summarise(read_tables(rows, CASE))
    headers = {"share": "Decided %", "decided": "Dial decided", "open": "Dial open", "cd": "CD mm", "sd": "SD"}
    headers |= {"floor": "Floor", "pwr2": "PWR@2 %", "p90": "p90"} | {name: words(name) for name in PARTS}
    view = [View("Reality", lambda row: words(row["reality"])), *views(TABLE, {"what": "What"} | headers)]
    caption = (
        f"Dials at which sliding finite elements with the true motion are as far from the scan as in the literature "
        f"and a perfect learner explains 10, 37 or 56 % of the square ({cohort}), and what they have there."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
