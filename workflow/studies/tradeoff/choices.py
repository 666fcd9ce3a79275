"""The setting that a budget allows, and how well the measured Pareto front predicts it."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import Column, check, number, read_table
from pinnochio.errors import InputError
from pinnochio.tables.document import Block, Table, views
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.pareto_front import LEVEL, SAFETY, choose_setting
from studies.tradeoff.table import summarise

NEAR = 0.25  # of the measured error

CHOICES = (
    Column("asked", str, "", "budget in seconds"),
    Column("n", int, "", "predictions: patients for whom the others' Pareto front offers something"),
    Column("kept", int, "", "of them, how many kept the budget"),
    Column("setting", str, "", "what was chosen, most often first"),
    number("seconds_max", "s", "longest of them"),
    number("cd_expected", "mm", "mean Chamfer distance expected"),
    number("cd", "mm", "mean Chamfer distance measured"),
    number("cd_near", "", "share of predictions whose Chamfer distance expected is within 25 % of it", ".2f"),
    number("cd_within", "mm", f"mean half-width of the interval about cd_expected that shall hold {LEVEL:.0%} of them"),
    number("cd_inside", "", "share of predictions that it holds; empty where the others are too few for one", ".2f"),
    number("face_error_expected", "mm", "mean distance from the reference solution expected"),
    number("face_error", "mm", "mean distance from the reference solution measured"),
)


def check_choices(rows: pd.DataFrame, budgets: Sequence[float]) -> pd.DataFrame:
    """One row of CHOICES per budget: each patient's choice from the Pareto front of all the others.

    rows: of TRADEOFF_CASES, of two patients at least.
    """
    summaries = {case: summarise(rows[rows["case"] != case]) for case in rows["case"].unique()}
    keyed = rows.set_index(["case", "method", "parameter", "value"])
    tried = []
    for limit in budgets:
        pairs = []
        for case, summary in summaries.items():
            try:
                chosen = choose_setting(summary, limit)
            except InputError:
                continue
            pairs.append((chosen, keyed.loc[(case, chosen["method"], chosen["parameter"], chosen["value"])]))
        row = {"asked": f"budget_seconds {limit:g}", "n": len(pairs), "kept": 0, "setting": "none"}
        if pairs:
            expected, measured = (pd.DataFrame(side).reset_index(drop=True) for side in zip(*pairs, strict=True))
            kept = measured["seconds"] <= limit
            settings = expected["method"] + " " + expected["parameter"] + " " + expected["value"]
            row |= {"kept": int(kept.sum()), "setting": "; ".join(settings.value_counts().index)}
            row |= {"seconds_max": measured["seconds"].max()}
            error, within = (expected["cd"] - measured["cd"]).abs(), expected["cd_within"]
            row |= {"cd_near": (error <= NEAR * measured["cd"]).mean(), "cd_within": within.mean()}
            row |= {"cd_inside": (error <= within)[within.notna()].mean()}
            for measure in ("cd", "face_error"):
                row |= {f"{measure}_expected": expected[measure].mean(), measure: measured[measure].mean()}
        tried.append(row)
    frame = pd.DataFrame(tried)
    return check(frame.reindex(columns=[column.name for column in CHOICES]), CHOICES)


def tabulate(cases: str | os.PathLike, budgets: Sequence[float], cohort: str) -> Table:
    """Budgets in s, tried on each patient of tradeoff_cases.csv by the others' Pareto front."""
    frame = check_choices(read_table(cases, TRADEOFF_CASES), budgets)
    headers = {
        "asked": "Asked",
        "setting": "Chosen",
        "n": "Predictions",
        "kept": "Kept",
        "seconds_max": "Longest s",
        "cd_expected": "CD expected mm",
        "cd": "CD mm",
        "cd_near": "within 25 %",
        "cd_within": "± mm",
        "cd_inside": "inside",
        "face_error_expected": "Face expected mm",
        "face_error": "Face mm",
    }
    caption = (
        f"Choices from the Pareto front, {cohort}: for each patient from the Pareto front of all the others, whose "
        f"settings kept the budget with a margin of {SAFETY:g}, and what the choice then took and missed on the "
        "patient."
    )
    return Table(frame, CHOICES, [Block.of(frame, views(CHOICES, headers), caption, "Budgets")])
