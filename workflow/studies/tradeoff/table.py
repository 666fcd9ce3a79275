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
    """Paragraphs on rows of TRADEOFF: the best under each of LIMITS, and what did not converge."""
    sound = frame[(frame["failed"] == 0) & frame[["cd", "seconds"]].notna().all(axis=1)]
    under = [(f"{limit:g} s", sound[sound["seconds"] < limit]) for limit in LIMITS]
    pairs = [(*one, *error) for one in under if len(one[1]) for error in ERRORS.items()]
    best = [f"under {limit} {_best(fast, error)} is nearest to {what}" for limit, fast, error, what in pairs]
    failed = [f"{named(row)} ({row['failed']} of {row['n']})" for _, row in frame[frame["failed"] > 0].iterrows()]
    return [
        f"Best per plan, {cohort}, n = {frame['n'].max()} patients: {'; '.join(best) or 'nothing is so fast'}.",
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


def _best(rows: pd.DataFrame, error: str) -> str:
    row = rows.sort_values([error, "seconds"]).iloc[0]
    return f"{named(row)} ({row[error]:.3f} mm, {row['seconds']:.3g} s)"


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
