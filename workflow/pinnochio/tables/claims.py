"""The paper's claims of one method over another, each beside the same comparison here."""

import os
from collections.abc import Mapping

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number, read_table
from pinnochio.metrics.case_columns import BY_NAME, CASES, scanned
from pinnochio.seeds import derive_seed
from pinnochio.statistics.wilcoxon import holm
from pinnochio.tables.comparison import paired
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.tables.published import OURS, SOURCE, TABLE_1, TABLE_2, VARIANTS

LEVEL = 0.05  # of Holm's p
MARGIN = 0.05  # mm of CD within which two methods count as equal, named before the cohort is read
PAPERS = "PINNOCHIO"  # the paper's own method, by its name there
REPRODUCED, OPPOSITE, ABSENT = "reproduced", "opposite", "not measured"
EQUAL, UNKNOWN = "equal within the margin", "unknown"
# By the paper's columns: the column of cases, and whether large (1) or small (-1) is good. J and residual are those of
# the network's own field.
MEASURES = {
    "cd": ("cd", -1),
    "hd": ("hd95", -1),
    "pwr1": ("pwr1", 1),
    "pwr2": ("pwr2", 1),
    "eqres": ("raw_eqres_paper", -1),
    "jacobian": ("raw_min_jacobian", 1),
}
CLAIMS = (
    Column("better", str, "", "method that the paper calls better"),
    Column("worse", str, "", "method that it calls worse"),
    Column("measure", str, "", "column of cases"),
    Column("unit", str, "", "of the measure, here and in the paper where that gives one", optional=True),
    number("theirs_better", "", "the paper's mean of the better method", ".4g"),
    number("theirs_worse", "", "its mean of the worse one", ".4g"),
    number("ours_better", "", "mean here of the better method, over the pairs", ".4g"),
    number("ours_worse", "", "mean here of the worse one", ".4g"),
    number("difference", "", "mean difference here, better minus worse", ".4g"),
    number("low", "", "lower end of its bootstrap 95% interval", ".4g"),
    number("high", "", "upper end of it", ".4g"),
    number("pairs", "", "patients that both methods have", ".0f"),
    number("p", "", "two-sided Wilcoxon signed-rank test of the pairs", ".6g"),
    number("p_holm", "", "p after Holm's correction over all claims", ".6g"),
    Column("test", str, "", "how p was made, or why there is none"),
    Column("verdict", str, "", f"{REPRODUCED}, {OPPOSITE}, {EQUAL}, {UNKNOWN} or {ABSENT}"),
)


def tabulate(cases: str | os.PathLike, cohort: str, seed: int) -> Table:
    """The patients of cases.csv that have a post-operative scan."""
    return table(scanned(read_table(cases, CASES)), cohort, seed)


def table(cases: pd.DataFrame, cohort: str, seed: int) -> Table:
    """The same of rows of CASES."""
    rows = [*_compared(cases, TABLE_1, OURS, seed), *_compared(cases, TABLE_2, VARIANTS, seed)]
    frame = pd.DataFrame(rows, columns=[*(column.name for column in CLAIMS), "sign"])
    frame["p_holm"] = holm(frame["p"])
    frame["verdict"] = [_verdict(row) for row in frame.to_dict("records")]
    frame = check(frame.drop(columns="sign"), CLAIMS)
    texts = {column.name: column for column in CLAIMS}

    def pair(one: str, other: str):
        return lambda row: f"{texts[one].text(row[one])} against {texts[other].text(row[other])}"

    view = [
        View("Claim", lambda row: f"{row['better']} before {row['worse']}"),
        *views(CLAIMS, {"measure": "Measure", "unit": "Unit"}),
        View("Paper", pair("theirs_better", "theirs_worse")),
        View("Here", pair("ours_better", "ours_worse")),
        View("Difference", lambda row: "{difference:.3g} [{low:.3g}, {high:.3g}]".format(**row)),
        *views(CLAIMS, {"pairs": "n"}),
        View("p (Holm)", lambda row: texts["p_holm"].text(row["p_holm"]) or row["test"]),
        *views(CLAIMS, {"verdict": "Verdict"}),
    ]
    caption = (
        f"What the paper ({SOURCE}) says of one method over another, and the same comparison on the {cohort}: means "
        "over patients; difference: better minus worse, with its bootstrap 95% interval; two-sided Wilcoxon "
        f"signed-rank test, Holm-corrected over all claims. {REPRODUCED}: the paper's sign and p < {LEVEL}; "
        f"{OPPOSITE}: the other sign and p < {LEVEL}; else {EQUAL}: the interval of CD lies within {MARGIN:g} mm, or "
        f"{UNKNOWN}; {ABSENT}: a method is not in the study. ACMT-Net and DGCFP are pretrained. The paper's HD "
        "stands beside our 95th percentile, its residual, whose unit it does not give, beside the mean squared force "
        "of the free nodes; J and residual are those of the field as the network gives it."
    )
    return Table(frame, CLAIMS, [Block.of(frame, view, caption)])


def _compared(cases: pd.DataFrame, published: pd.DataFrame, names: Mapping[str, str], seed: int) -> list[dict]:
    """The claims of a table of the paper: its own method before each other one, by every measure that it gives."""
    theirs = published.set_index("method")
    return [
        _claim(cases, theirs, worse, measure, names, seed)
        for worse in theirs.index
        if worse != PAPERS
        for measure in MEASURES
        if f"{measure}_mean" in theirs
    ]


def _claim(cases, theirs, worse: str, measure: str, names: Mapping[str, str], seed: int) -> dict:
    name, sign = MEASURES[measure]
    one, two = names[PAPERS], names[worse]
    row = {"better": one, "worse": two, "measure": name, "unit": BY_NAME[name].unit, "sign": sign}
    row |= {f"theirs_{end}": theirs.loc[who, f"{measure}_mean"] for end, who in (("better", PAPERS), ("worse", worse))}
    if not {one, two} <= set(cases["method"]):
        absent = " and ".join(method for method in (one, two) if method not in set(cases["method"]))
        return row | {"test": f"{absent} not in the study"}
    both = cases.pivot(index="case", columns="method", values=name)[[one, two]].dropna()
    test = paired(cases, name, one, two, derive_seed(seed, "bootstrap", f"{one}/{two}/{name}"))
    row |= {"ours_better": both[one].mean(), "ours_worse": both[two].mean()}
    row |= {"difference": test.mean, "low": test.low, "high": test.high}
    return row | {"pairs": test.n, "p": test.p, "test": test.statement}


def _verdict(row: Mapping) -> str:
    if np.isnan(row["difference"]):
        return ABSENT
    if not row["p_holm"] < LEVEL:
        return EQUAL if row["measure"] == "cd" and max(-row["low"], row["high"]) < MARGIN else UNKNOWN
    return REPRODUCED if row["difference"] * row["sign"] > 0 else OPPOSITE
