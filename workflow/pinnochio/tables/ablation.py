"""Tables that set variants of one network beside each other: the paper's ablation, and the design study."""

import os
from collections.abc import Mapping

import pandas as pd

from pinnochio.tables.accuracy import ACCURACY, significance, spread, starred, summarise
from pinnochio.tables.engine import Column, View, write_csv, write_twins

ABLATION = (
    *ACCURACY[:1],
    Column("decomposition", bool, "", "whether interface networks precede the volume networks"),
    Column("physics", bool, "", "whether the equilibrium residual is in the loss"),
    *ACCURACY[1:],
)
DESIGN = (
    *ACCURACY[:1],
    Column("change", str, "", "what differs from the base", optional=True),
    *ACCURACY[1:],
)


def write_ablation(
    cases: pd.DataFrame,
    variants: Mapping[str, Mapping],
    path: str | os.PathLike,
    cohort: str,
    seed: int,
) -> None:
    """Write ablation.csv and its twins in the form of the paper's Table 2; the last variant is the full model.

    cases: rows of cases.csv; variants: settings of each method by name.
    """
    methods, full = list(variants), list(variants)[-1]
    frame = summarise(cases, full, methods, seed)
    frame["decomposition"] = [variants[name]["network"]["decomposition"] for name in methods]
    frame["physics"] = [_has_physics(variants[name]) for name in methods]
    frame = write_csv(frame, path, ABLATION)
    view = [
        View("Decomposition", lambda row: "yes" if row["decomposition"] else "no"),
        View("Physics", lambda row: "yes" if row["physics"] else "no"),
        View("CD mm", starred(spread("cd")), -1),
        View("PWR@1 %", spread("pwr1"), 1),
        View("EqRes", spread("eqres_rel"), -1),
        View("min J", spread("raw_min_jacobian"), 1),
        View("p vs full", significance),
    ]
    caption = (
        f"Ablation of {full} on the {cohort}, n = {frame['n'].min()} patients: mean ± standard deviation. EqRes: "
        "residual of the free nodes over the force of all others; min J: smallest volume ratio of an element as the "
        "network gives it. Bold: best mean. p: two-sided Wilcoxon signed-rank test of CD against the full model, "
        "Holm-corrected; * p < 0.05."
    )
    write_twins(frame, path, view, caption, ABLATION)


def write_design(
    cases: pd.DataFrame, changes: Mapping[str, str], path: str | os.PathLike, cohort: str, seed: int
) -> None:
    """Write design.csv and its twins: each switch of the first method, on its own, against that method.

    changes: what differs, by name of the method; empty for the first.
    """
    methods, base = list(changes), list(changes)[0]
    frame = summarise(cases, base, methods, seed)
    frame["change"] = [changes[name] for name in methods]
    frame = write_csv(frame, path, DESIGN)
    view = [
        View("Network", lambda row: row["method"].removeprefix("design_")),
        View("CD mm", starred(spread("cd")), -1),
        View("Volume error mm", spread("volume_error_mean"), -1),
        View("EqRes", spread("eqres_rel"), -1),
        View("min J", spread("raw_min_jacobian"), 1),
        View("Seconds", spread("seconds"), -1),
        View("p vs base", significance),
    ]
    caption = (
        f"Switches of {base}, one at a time, on the {cohort}, n = {frame['n'].min()} patients: mean ± standard "
        "deviation. Volume error: mean distance to the simulated truth; EqRes and min J as in the ablation. Bold: best "
        f"mean. p: two-sided Wilcoxon signed-rank test of CD against {base}, Holm-corrected; * p < 0.05."
    )
    write_twins(frame, path, view, caption, DESIGN)


def _has_physics(settings: Mapping) -> bool:
    return any(settings[phase]["weights"]["physics"] > 0 for phase in ("pretraining", "finetuning"))
