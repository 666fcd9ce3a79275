"""The trade-off: means of every setting over the patients with the Pareto fronts, and what they say."""

import os

import numpy as np
import pandas as pd

from pinnochio.columns import check, read_table
from pinnochio.methods.names import BASELINE, CEILING, FLOOR
from pinnochio.metrics.case_columns import CASES
from pinnochio.seeds import derive_seed
from pinnochio.tables.comparison import BOUNDS, against_baseline
from pinnochio.tables.document import Block, Table, View, views
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.setting_columns import SETTING, TRADEOFF
from studies.tradeoff.settings import BASE

FRONTS = {"cd": "front_outcome", "face_error": "front_reference"}
ERRORS = {"cd": "the outcome", "face_error": "the reference solution"}
LIMITS = (0.1, 1.0, 10.0)  # s


def summarise(rows: pd.DataFrame, outcomes: pd.DataFrame) -> pd.DataFrame:
    """One row of TRADEOFF per setting of rows of TRADEOFF_CASES, in the order of their first appearance, then one per
    other method of `outcomes`, rows of CASES: what the study judged against the outcome stands in the rows of its
    settings."""
    judged, summaries = against_outcome(outcomes), []
    for key, group in check(rows, TRADEOFF_CASES).groupby([column.name for column in SETTING], sort=False):
        row = {column.name: word for column, word in zip(SETTING, key, strict=True)}
        if row["value"].endswith(BASE):
            row = judged.pop(row["method"], {}) | row
        row |= {"n": len(group), "failed": int((~group["converged"]).sum())}
        names = ("nodes", "seconds", "setup_seconds", "face_error", "volume_error", "eqres_rel")
        row |= {name: group[name].mean() for name in names}
        row |= {"seconds_max": group["seconds"].max(), "inverted": group["inverted"].sum(min_count=1)}
        row |= {"face_error_max": group["face_error_max"].max(), "min_jacobian": group["min_jacobian"].min()}
        summaries.append(row)
    frame = pd.DataFrame([*summaries, *judged.values()], columns=[column.name for column in TRADEOFF])
    for error, column in FRONTS.items():
        frame[column] = pareto(frame["seconds"], frame[error].where((frame["failed"] == 0) & frame["seconds"].notna()))
    return check(frame, TRADEOFF)


def against_outcome(outcomes: pd.DataFrame) -> dict[str, dict]:
    """Cells of TRADEOFF by method, of rows of CASES: as the study predicted, judged and timed. Of the bounds those that
    are lines of the picture."""
    baseline, cells = outcomes[outcomes["method"] == BASELINE], {}
    outcomes = outcomes[~outcomes["method"].isin({*BOUNDS} - {FLOOR, CEILING})]
    for method, group in outcomes.groupby("method", sort=False):
        row = {"method": method, "parameter": "none", "value": BASE, "n": len(group)}
        row["failed"] = int((group["cd"].isna() | ~group["converged"]).sum())
        row |= {"cd": group["cd"].mean(), "cd_sd": group["cd"].std()}
        row |= {"seconds": group["seconds"].mean(), "seconds_max": group["seconds"].max()}
        row["setup_seconds"] = group["setup_seconds"].mean()
        cells[method] = row | against_baseline(group, baseline, derive_seed(0, "bootstrap", method))
    return cells


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
    sound = frame[(frame["failed"] == 0) & frame["seconds"].notna()]
    under = [(f"{limit:g} s", sound[sound["seconds"] < limit]) for limit in LIMITS]
    pairs = [(*one, *error) for one in under for error in ERRORS.items() if one[1][error[0]].notna().any()]
    best = [f"under {limit} {_best(fast, error)} is nearest to {what}" for limit, fast, error, what in pairs]
    failed = [f"{named(row)} ({row['failed']} of {row['n']})" for _, row in frame[frame["failed"] > 0].iterrows()]
    return [
        f"Best per plan, {cohort}: {'; '.join(best) or 'nothing is so fast'}.",
        f"Not converged on every patient, and so on no Pareto front: {'; '.join(failed) or 'nothing'}.",
    ]


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


def tabulate(cases: str | os.PathLike, judged: str | os.PathLike, cohort: str) -> Table:
    """The rows of tradeoff_cases.csv by setting, and of the study's cases.csv by method."""
    rows = read_table(cases, TRADEOFF_CASES)
    frame = summarise(rows, read_table(judged, CASES))
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
        f"Seconds against accuracy, {cohort}, n = {rows['case'].nunique()} held-out patients. Seconds: one plan, warm, "
        "nothing else running (no parameter: as in the study, with other jobs beside it); set-up: what the patient "
        "takes beside the mesh. CD: Chamfer distance to the outcome, of all patients of the study. Face, volume: "
        "distance from the reference solution, sliding finite elements on the finest mesh. EqRes: residual of the "
        "study's elements. Pareto front: nothing is faster and nearer to the outcome (CD) or the reference (face)."
    )
    said = answers(frame, cohort)
    if missing:
        said.append(f"Without face and volume error, since the reference did not converge: {', '.join(missing)}.")
    return Table(frame, TRADEOFF, [Block.of(frame, view, caption)], said)
