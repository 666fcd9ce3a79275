"""The accuracy of every method, in the form of the paper's Table 1."""

import os
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from pinnochio.columns import read_table
from pinnochio.methods.names import BASELINE, FLOOR
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.metrics.worst_point import FLAGGED
from pinnochio.statistics.attainable import attainable
from pinnochio.tables.comparison import (
    COMPARISON,
    bounds_caption,
    count,
    share,
    significance,
    spread,
    starred,
    summarise,
    worst_point,
)
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.tables.published import published_block


def tabulate(
    cases: str | os.PathLike,
    methods: Sequence[str],
    bounds: Sequence[str],
    reference: str | None,
    published: bool,
    cohort: str,
    seed: int,
) -> Table:
    """The patients of cases.csv that have a post-operative scan, method by method and bound by bound.

    published: whether the paper's own values stand below in the twins.
    """
    frame = summarise(scanned(read_table(cases, CASES)), reference, methods, seed, bounds)
    return table(frame, cohort, [published_block()] if published else [])


def table(frame: pd.DataFrame, cohort: str, further: Sequence[Block] = ()) -> Table:
    """The table in the form of the paper's Table 1; bold: best; *: Holm p < 0.05; then bounds and further blocks."""
    methods, bounds = frame[~frame["bound"]], frame[frame["bound"]]
    tested = attainable(int(methods["n"].max()), len(methods) - 1)
    view = [
        *views(COMPARISON, {"method": "Method"}),
        View("CD mm", starred(spread("cd")), -1),
        View("HD95 mm", spread("hd95"), -1),
        View("P99 mm", spread("p99"), -1),
        View("Worst point mm", worst_point),
        View("PWR@1 %", spread("pwr1"), 1),
        View("PWR@2 %", spread("pwr2"), 1),
        *views(COMPARISON, {"seconds_mean": "Seconds"}, {"seconds_mean": -1}),
        *([View("Explained", share)] if frame["explained"].notna().any() else []),
        *(views(COMPARISON, {"of_ceiling": "Of the ceiling"}) if frame["of_ceiling"].notna().any() else []),
        *([View("p vs reference", significance)] if tested else []),
    ]
    reference = ", ".join(frame.loc[frame["reference"], "method"])
    test = (
        f"p: two-sided Wilcoxon signed-rank test of CD against {reference or 'the reference'}, Holm-corrected; * p < "
        "0.05."
        if tested
        else "No p is shown: of so few patients no outcome could be significant."
    )
    caption = (
        f"Accuracy on the {cohort}, {count(methods['n'])} patients: mean ± standard deviation. Bold: best mean. {test} "
        f"Worst point: the largest distance, mean of the patients and the worst of them; ! n: in n patients a point of "
        f"the skin lies more than {FLAGGED:g} mm from every other method's prediction of it. "
        f"Seconds: one plan, warm, with other jobs beside it. Explained: what CD is below that of {BASELINE}, as "
        f"a share of what that is above {FLOOR}, with its bootstrap 95% interval over patients; without these two "
        "there is none."
    )
    blocks = [Block.of(methods, view, caption)]
    if len(bounds):
        blocks.append(
            Block.of(bounds, [replace(column, sign=0) for column in view], bounds_caption(bounds["method"]), "Bounds")
        )
    return Table(frame, COMPARISON, [*blocks, *further])
