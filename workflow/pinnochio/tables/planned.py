"""What it costs to predict from the plan: every method given the achieved motion, and given the planned one."""

import os
from collections.abc import Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.metrics.case_columns import BY_NAME, CASES
from pinnochio.seeds import derive_seed
from pinnochio.statistics.wilcoxon import compare, holm
from pinnochio.tables.comparison import count, spread, starred
from pinnochio.tables.document import Block, Table, View, views, with_interval

COMPARED = ("cd", "hd95", "pwr1", "pwr2")
PLANNED = (
    Column("method", str, "", "method"),
    Column("n", int, "", "patients predicted with both motions"),
    *(
        number(f"{name}_{arm}_{part}", BY_NAME[name].unit, f"{word} of {name}, {arm} motion", BY_NAME[name].summary)
        for name in COMPARED
        for arm in ("achieved", "planned")
        for part, word in (("mean", "mean"), ("sd", "standard deviation"))
    ),
    number("cost", "mm", "mean of cd planned minus achieved"),
    number("cost_low", "mm", "end of the bootstrap 95% interval of cost"),
    number("cost_high", "mm", "end of the bootstrap 95% interval of cost"),
    number("p", "", "two-sided Wilcoxon signed-rank test of cd planned against achieved", ".3g"),
    number("p_holm", "", "p after Holm's correction over the methods", ".3g"),
    Column("test", str, "", "how p was made, or why there is none"),
)


def tabulate(
    achieved: Sequence[str | os.PathLike],
    planned: Sequence[str | os.PathLike],
    cases: Sequence[str],
    methods: Sequence[str],
    cohort: str,
    seed: int,
) -> Table:
    """achieved, planned: metrics of the same methods with either motion; cases: the patients that have both."""
    arms = {"achieved": read_tables(achieved, CASES), "planned": read_tables(planned, CASES)}
    return table(summarise({arm: rows[rows["case"].isin(cases)] for arm, rows in arms.items()}, methods, seed), cohort)


def summarise(arms: dict[str, pd.DataFrame], methods: Sequence[str], seed: int) -> pd.DataFrame:
    """One row of PLANNED per method, over the patients that it predicts in both arms."""
    rows = []
    for method in methods:
        cases = {arm: frame[frame["method"] == method].set_index("case")[list(COMPARED)] for arm, frame in arms.items()}
        both = cases["achieved"].dropna().index.intersection(cases["planned"].dropna().index)
        row = {"method": method, "n": len(both)}
        for arm, values in cases.items():
            for name in COMPARED:
                row[f"{name}_{arm}_mean"] = values.loc[both, name].mean()
                row[f"{name}_{arm}_sd"] = values.loc[both, name].std()
        pair = [cases[arm].loc[both, "cd"] for arm in ("planned", "achieved")]
        test = compare(*pair, derive_seed(seed, "bootstrap planned", method))
        row |= {"cost": test.mean, "cost_low": test.low, "cost_high": test.high, "p": test.p, "test": test.statement}
        rows.append(row)
    frame = pd.DataFrame(rows)
    return check(frame.assign(p_holm=holm(frame["p"])), PLANNED)


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """Both arms side by side; bold: best of its column."""
    columns = {column.name: column for column in PLANNED}
    view = [
        *views(PLANNED, {"method": "Method"}),
        View("CD mm, achieved", spread("cd_achieved", columns), -1),
        View("CD mm, planned", spread("cd_planned", columns), -1),
        View("Cost mm", starred(with_interval(PLANNED, "cost", "cost_low", "cost_high"))),
        View("HD95 mm, planned", spread("hd95_planned", columns), -1),
        View("PWR@2 %, achieved", spread("pwr2_achieved", columns), 1),
        View("PWR@2 %, planned", spread("pwr2_planned", columns), 1),
        View("p", lambda row: row["test"] if np.isnan(row["p_holm"]) else columns["p_holm"].text(row["p_holm"])),
    ]
    caption = (
        f"Predicted with the achieved motion and from the plan; {cohort}, {count(frame['n'])} patients: mean ± "
        "standard deviation. The plan is what a surgeon has beforehand, so its columns are what a prediction before "
        "surgery is worth; with the achieved motion, registered on the bones after surgery, the other tables judge, "
        "as the field does. Networks and regressions are the same in both. Cost: mean of the paired differences of "
        "CD, planned minus achieved, with its 95% bootstrap interval; p: two-sided Wilcoxon signed-rank test, "
        "Holm-corrected over the methods; * p < 0.05. Bold: best mean."
    )
    return Table(frame, PLANNED, [Block.of(frame, view, caption)])
