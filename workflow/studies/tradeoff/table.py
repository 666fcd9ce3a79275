"""The trade-off: means of every setting over the patients with the Pareto fronts, and what they say."""

import os

import numpy as np
import pandas as pd

from pinnochio.columns import check, read_table
from pinnochio.methods.names import BASELINE
from pinnochio.seeds import derive_seed
from pinnochio.tables.comparison import against_baseline
from pinnochio.tables.document import Block, Table, View, views
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.setting_columns import SETTING, TRADEOFF
from studies.tradeoff.settings import BASE

FRONTS = {"cd": "front_outcome", "face_error": "front_reference"}
ERRORS = {"cd": "the outcome", "face_error": "the reference solution"}
LIMITS = (0.1, 1.0, 10.0)  # s
LAST = 0.1  # mm


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """One row of TRADEOFF per setting, in the order of their first appearance, of rows of TRADEOFF_CASES."""
    rows = check(rows, TRADEOFF_CASES)
    summaries, baseline = [], rows[(rows["method"] == BASELINE) & as_studied(rows)]
    for key, group in rows.groupby([column.name for column in SETTING], sort=False):
        row = dict(zip((column.name for column in SETTING), key, strict=True))
        row |= {"n": len(group), "failed": int((~group["converged"]).sum())}
        names = ("nodes", "seconds", "setup_seconds", "cd", "face_error", "volume_error", "eqres_rel")
        row |= {name: group[name].mean() for name in names}
        row |= {"seconds_max": group["seconds"].max(), "cd_sd": group["cd"].std(), "inverted": group["inverted"].sum()}
        row |= against_baseline(group[group["seconds"].notna()], baseline, derive_seed(0, "bootstrap", "/".join(key)))
        row |= {"face_error_max": group["face_error_max"].max(), "min_jacobian": group["min_jacobian"].min()}
        summaries.append(row)
    frame = pd.DataFrame(summaries)
    frame.loc[frame["min_jacobian"].isna(), "inverted"] = np.nan
    for error, column in FRONTS.items():
        frame[column] = pareto(frame["seconds"], frame[error].where((frame["failed"] == 0) & frame["seconds"].notna()))
    return check(frame, TRADEOFF)


def pareto(seconds, errors) -> np.ndarray:
    """Rows (n,) bool that no other row beats in one without losing in the other; never those without a number."""
    seconds, errors = np.asarray(seconds, float), np.asarray(errors, float)
    optimal, best = np.zeros(len(seconds), bool), np.inf
    for row in np.lexsort((errors, seconds)):
        if errors[row] < best:  # not of NaN
            optimal[row], best = True, errors[row]
    return optimal


def answers(frame: pd.DataFrame, cohort: str) -> list[str]:
    """Paragraphs on rows of TRADEOFF: the best under each of LIMITS, the last 0.1 mm, what is dominated."""
    sound = frame[(frame["failed"] == 0) & frame[["cd", "seconds"]].notna().all(axis=1)]
    best, cost, worse = [], [], []
    for limit in LIMITS:
        fast = sound[sound["seconds"] < limit]
        best += [
            f"under {limit:g} s {_best(fast, error)} is nearest to {what}"
            for error, what in ERRORS.items()
            if len(fast)
        ]
    for error, what in ERRORS.items():
        optimal = sound[sound[FRONTS[error]] & (sound[error] > 0)].sort_values("seconds")  # not the reference itself
        last = optimal.iloc[-1]
        near = optimal[optimal[error] <= last[error] + LAST].iloc[0]
        ratio = last["seconds"] / max(near["seconds"], 1e-9)
        cost.append(
            f"against {what} from {_shown(near, error)} to {_shown(last, error)}, {ratio:.3g} times as long"
            if ratio > 1
            else f"against {what} nothing faster comes so near to the best, {_shown(last, error)}"
        )
    for _, group in sound.groupby("method", sort=False):
        if not group[list(FRONTS.values())].to_numpy().any():
            one = group.sort_values("cd").iloc[0]
            better = sound[(sound["seconds"] <= one["seconds"]) & (sound["cd"] < one["cd"])]
            beaten = f", beaten by {_best(better, 'cd')}" if len(better) else ""
            worse.append(f"{_shown(one, 'cd')}{beaten}")
    failed = [f"{named(row)} ({row['failed']} of {row['n']})" for _, row in frame[frame["failed"] > 0].iterrows()]
    return [
        f"Best per plan, {cohort}, n = {frame['n'].max()} patients: {'; '.join(best) or 'nothing is so fast'}.",
        f"What the last {LAST} mm cost: {'; '.join(cost)}.",
        f"On neither Pareto front at any setting, so not to be used: {'; '.join(worse) or 'no method'}.",
        f"Not converged on every patient, and so on no Pareto front: {'; '.join(failed) or 'nothing'}.",
    ]


def as_studied(rows: pd.DataFrame) -> pd.Series:
    """Which rows have a method as the study predicts by it."""
    return rows["value"].str.endswith(BASE)


def named(row) -> str:
    """A setting as it is read."""
    if row["parameter"] == "none":
        return row["method"]
    return f"{row['method']}, {row['parameter']} {row['value'].split(',')[0]}"


def _shown(row, error: str) -> str:
    return f"{named(row)} ({row[error]:.3f} mm, {row['seconds']:.3g} s)"


def _best(rows: pd.DataFrame, error: str) -> str:
    return _shown(rows.sort_values([error, "seconds"]).iloc[0], error)


def _fronts(row) -> str:
    return " ".join(word for word, column in (("CD", "front_outcome"), ("face", "front_reference")) if row[column])


def tabulate(cases: str | os.PathLike, cohort: str) -> Table:
    """The rows of tradeoff_cases.csv by setting."""
    rows = read_table(cases, TRADEOFF_CASES)
    frame = summarise(rows)
    missing = sorted(rows["case"][rows.groupby("case")["face_error"].transform("count") == 0].unique())
    headers = {
        "method": "Method",
        "parameter": "Parameter",
        "value": "Value",
        "nodes": "Nodes",
        "seconds": "Seconds",
        "setup_seconds": "Set-up s",
        "cd": "CD mm",
        "face_error": "Face mm",
        "face_error_max": "largest mm",
        "volume_error": "Volume mm",
        "eqres_rel": "EqRes",
        "min_jacobian": "min J",
        "failed": "Failed",
    }
    view = [*views(TRADEOFF, headers, {"seconds": -1, "cd": -1}), View("Pareto front", _fronts)]
    caption = (
        f"Seconds against accuracy, {cohort}, n = {frame['n'].max()} held-out patients. Seconds: one plan, warm, "
        "nothing else running (no parameter: as in the study, with other jobs beside it); set-up: what the patient "
        "takes beside the mesh. CD: Chamfer distance to the outcome. Face, volume: distance from the reference "
        "solution, sliding finite elements on the finest mesh. EqRes: residual of the study's elements. Pareto front: "
        "nothing is faster and nearer to the outcome (CD) or the reference (face)."
    )
    said = answers(frame, cohort)
    if missing:
        said.append(f"Without face and volume error, since the reference did not converge: {', '.join(missing)}.")
    return Table(frame, TRADEOFF, [Block.of(frame, view, caption)], said)
