"""The comparison of methods over the patients: means, tests against a reference, and the table of the paper's form."""

import os
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.errors import InputError
from pinnochio.seeds import derive_seed
from pinnochio.statistics.significance import Comparison, compare, holm
from pinnochio.tables.engine import CASES, Block, Column, View, check, number, write_csv, write_twins

# What is averaged over patients: column of cases -> also its standard deviation.
SUMMARISED = {
    "cd": True,
    "hd95": True,
    "pwr1": True,
    "pwr2": True,
    "seconds": True,
    "setup_seconds": False,
    "min_jacobian": True,
    "raw_min_jacobian": True,
    "eqres_rel": True,
    "eqres_disp": False,
    "volume_error_mean": True,
    "skin_error_mean": True,
}
_CASE = {column.name: column for column in CASES}


def _summaries() -> list[Column]:
    columns = []
    for name, spread in SUMMARISED.items():
        source = _CASE[name]
        columns.append(number(f"{name}_mean", source.unit, f"mean of {name}", source.summary))
        if spread:
            columns.append(number(f"{name}_sd", source.unit, f"standard deviation of {name}", source.summary))
    return columns


ACCURACY = (
    Column("method", str, "", "method"),
    Column("reference", bool, "", "whether the others are tested against this method"),
    Column("n", int, "", "patients with a metric"),
    Column("failed", int, "", "patients without one, or whose solver did not converge"),
    *_summaries(),
    number("inverted", "", "inverted elements over all patients", ".0f"),
    number("pairs", "", "patients that the test compares", ".0f"),
    number("cd_median_difference", "mm", "median of cd minus the reference's"),
    number("cd_mean_difference", "mm", "mean of cd minus the reference's"),
    number("cd_low", "mm", "lower end of the bootstrap 95% interval of that mean"),
    number("cd_high", "mm", "upper end of it"),
    number("p", "", "two-sided Wilcoxon signed-rank test of cd", ".6g"),
    number("p_holm", "", "p after Holm's correction over the methods", ".6g"),
    Column("test", str, "", "how p came about, or why there is none"),
)
_ACCURACY = {column.name: column for column in ACCURACY}


def summarise(
    cases: pd.DataFrame, reference: str | None = "pinnochio", methods: Sequence[str] | None = None, seed: int = 0
) -> pd.DataFrame:
    """One row per method (in the order of `methods`, else by name): the ACCURACY columns, tested on cd.

    A patient without cd (failed prediction) counts as failed and is left out of that method's means; the
    test takes the patients that both methods have. Without a reference nothing is tested.
    """
    cases = check(cases, CASES)
    if cases.duplicated(["case", "method"]).any():
        raise InputError("-", "cases", "a case appears twice for one method", "keep one row per case and method")
    methods = list(methods) if methods is not None else sorted(cases["method"].unique())
    if unknown := [method for method in [*methods, reference] if method and method not in set(cases["method"])]:
        raise InputError("-", "cases", f"method {unknown[0]!r} has no row", "predict and evaluate it first")
    rows = []
    for method in methods:
        own = cases[cases["method"] == method]
        row = {"method": method, "reference": method == reference, "n": int(own["cd"].notna().sum())}
        row["failed"] = int((own["cd"].isna() | ~own["converged"]).sum())
        for name, spread in SUMMARISED.items():
            row[f"{name}_mean"] = own[name].mean()
            if spread:
                row[f"{name}_sd"] = own[name].std()
        row["inverted"] = own["inverted"].sum()
        found = paired(cases, "cd", method, reference, derive_seed(seed, "bootstrap", method))
        row |= {"pairs": found.n, "cd_median_difference": found.median, "cd_mean_difference": found.mean}
        row |= {"cd_low": found.low, "cd_high": found.high, "p": found.p, "test": found.statement}
        rows.append(row)
    frame = pd.DataFrame(rows)
    frame["p_holm"] = holm(frame["p"])
    return check(frame, ACCURACY)


def paired(cases: pd.DataFrame, measure: str, method: str, reference: str | None, seed: int) -> Comparison:
    """A method against the reference by one column of CASES, over the patients that both have.

    Of the reference itself, or without one, nothing but a statement.
    """
    if method == reference or reference is None:
        return Comparison.none("reference" if reference else "no reference: not tested")
    errors = cases.pivot(index="case", columns="method", values=measure)[[method, reference]].dropna()
    return compare(errors[method], errors[reference], seed)


def write_accuracy(
    frame: pd.DataFrame,
    path: str | os.PathLike,
    cohort: str = "virtual cohort",
    further: Sequence[Block] = (),
    paragraphs: Sequence[str] = (),
) -> None:
    """Write accuracy.csv and its twins in the form of the paper's Table 1; bold: best; *: Holm p < 0.05.

    further, paragraphs: what the twins hold below the table.
    """
    frame = write_csv(frame, path, ACCURACY)
    view = [
        View("Method", lambda row: row["method"]),
        View("CD mm", starred(spread("cd")), -1),
        View("HD95 mm", spread("hd95"), -1),
        View("PWR@1 %", spread("pwr1"), 1),
        View("PWR@2 %", spread("pwr2"), 1),
        View("Seconds", lambda row: _ACCURACY["seconds_mean"].text(row["seconds_mean"]), -1),
        View("p vs reference", significance),
    ]
    reference = ", ".join(frame.loc[frame["reference"], "method"])
    caption = (
        f"Accuracy on the {cohort}, {count(frame['n'])} patients: mean ± standard deviation. Bold: best mean. p: "
        f"two-sided Wilcoxon signed-rank test of CD against {reference or 'the reference'}, Holm-corrected; * p < "
        "0.05. Seconds: one plan, warm, with other jobs beside it."
    )
    write_twins(frame, path, view, caption, ACCURACY, further, paragraphs)


def count(n: pd.Series) -> str:
    """How many patients the rows of a table have, as captions say it."""
    return f"n = {n.min()}" if n.nunique() == 1 else f"n = {n.min()} to {n.max()}"


def spread(name: str, columns: Mapping[str, Column] = _ACCURACY) -> Callable:
    """Text of a row of these columns, by name: mean and standard deviation of a summarised one."""

    def text(row) -> str:
        mean, sd = (columns[f"{name}_{part}"].text(row[f"{name}_{part}"]) for part in ("mean", "sd"))
        return f"{mean} ± {sd}" if sd else mean

    return text


def starred(text: Callable) -> Callable:
    """The text of a row with a star where Holm's p is below 0.05."""
    return lambda row: text(row) + ("*" if row["p_holm"] < 0.05 else "")


def significance(row) -> str:
    """Text of a row of ACCURACY: Holm's p, or why there is none."""
    return row["test"] if np.isnan(row["p_holm"]) else _ACCURACY["p_holm"].text(row["p_holm"])
