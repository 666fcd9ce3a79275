"""The ablation, in the form of the paper's Table 2: the network without its parts, and whole."""

import os
from collections.abc import Mapping

import pandas as pd

from pinnochio.columns import Column, check, read_table
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.tables.comparison import COMPARISON, significance, spread, starred, summarise
from pinnochio.tables.document import Block, Table, View
from pinnochio.tables.published import published_ablation

ABLATION = (
    *COMPARISON[:1],
    Column("decomposition", bool, "", "whether interface networks precede the volume networks"),
    Column("physics", bool, "", "whether the equilibrium residual is in the loss"),
    *COMPARISON[1:],
)


def tabulate(cases: str | os.PathLike, variants: Mapping[str, Mapping], cohort: str, seed: int) -> Table:
    """The variants, settings by method, on the scanned patients of cases.csv; the last is the full model."""
    return table(scanned(read_table(cases, CASES)), variants, cohort, seed)


def table(cases: pd.DataFrame, variants: Mapping[str, Mapping], cohort: str, seed: int) -> Table:
    """The same of rows of CASES."""
    methods, full = list(variants), list(variants)[-1]
    frame = summarise(cases, full, methods, seed)
    frame["decomposition"] = [variants[name]["network"]["decomposition"] for name in methods]
    frame["physics"] = [_has_physics(variants[name]) for name in methods]
    frame = check(frame, ABLATION)
    view = [
        View("Decomposition", lambda row: "yes" if row["decomposition"] else "no"),
        View("Physics", lambda row: "yes" if row["physics"] else "no"),
        View("CD mm", starred(spread("cd")), -1),
        View("PWR@1 %", spread("pwr1"), 1),
        View("EqRes mN²", spread("raw_eqres_paper"), -1),
        View("EqRes", spread("raw_eqres_rel"), -1),
        View("EqRes repaired", spread("eqres_rel"), -1),
        View("min J", spread("raw_min_jacobian"), 1),
        View("min J repaired", spread("min_jacobian"), 1),
        View("p vs full", significance),
    ]
    caption = (
        f"Ablation of {full} on the {cohort}, n = {frame['n'].min()} patients: mean ± standard deviation. EqRes: "
        "residual of the free nodes, mN²: their mean squared force, as the paper has it, else over the force of all "
        "others; min J: smallest volume ratio of an element; both as the network gives the field, and as it is after "
        "the inversion repair and the corrections, if there are any. Bold: best mean. p: two-sided Wilcoxon "
        "signed-rank test of CD against the full model, Holm-corrected; * p < 0.05."
    )
    return Table(frame, ABLATION, [Block.of(frame, view, caption), published_ablation()])


def _has_physics(settings: Mapping) -> bool:
    return any(settings[phase]["weights"]["physics"] > 0 for phase in ("pretraining", "finetuning"))
