"""The design study: each switch of the better network, on its own, against that network."""

import os
from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio import overlays
from pinnochio.columns import Column, check, read_tables
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.tables.comparison import COMPARISON, significance, spread, starred, summarise
from pinnochio.tables.document import Block, Table, View

DESIGN = (*COMPARISON[:1], Column("change", str, "", "what differs from the base", optional=True), *COMPARISON[1:])


def tabulate(metrics: Sequence[str | os.PathLike], variants: Mapping[str, Mapping], cohort: str, seed: int) -> Table:
    """The networks of `variants`, settings by method, the base first, on the patients of the folds' metrics."""
    base = next(iter(variants.values()))
    named = {name: ", ".join(overlays.changes(base, settings)) for name, settings in variants.items()}
    return table(scanned(read_tables(metrics, CASES)), named, cohort, seed)


def table(cases: pd.DataFrame, changes: Mapping[str, str], cohort: str, seed: int) -> Table:
    """The same of rows of CASES; changes: what differs, by name of the method; empty for the first."""
    methods, base = list(changes), list(changes)[0]
    frame = summarise(cases, base, methods, seed)
    frame["change"] = [changes[name] for name in methods]
    frame = check(frame, DESIGN)
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
    return Table(frame, DESIGN, [Block.of(frame, view, caption)])
