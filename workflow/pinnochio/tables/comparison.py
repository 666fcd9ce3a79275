"""Methods compared over the patients: means, and tests against a reference, as several tables show them."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.errors import InputError
from pinnochio.methods.names import BASELINE, CEILING, FLOOR, in_sentence, written
from pinnochio.metrics.case_columns import BY_NAME, CASES
from pinnochio.metrics.worst_point import FLAGGED
from pinnochio.seeds import derive_seed
from pinnochio.statistics.shares import explained, of_means
from pinnochio.statistics.wilcoxon import Comparison, compare, holm
from pinnochio.tables.document import with_interval

# What bounds the methods, beside its name.
BOUNDS = {
    FLOOR: "the true skin against its own registered scan: noise, expression and registration; zero against the truth "
    "itself",
    CEILING: "what plan, motion, anatomy and covariates decide of the outcome, all that is random at its mean",
    "oracle": f"the mechanics of {in_sentence(BASELINE)} with the motion that was carried out",
}
# What is averaged over patients: column of cases -> also its standard deviation.
SUMMARISED = {
    "cd": True,
    "hd95": True,
    "p99": True,
    "hdmax": False,
    "pwr1": True,
    "pwr2": True,
    "seconds": True,
    "setup_seconds": False,
    "min_jacobian": True,
    "raw_min_jacobian": True,
    "eqres_rel": True,
    "eqres_paper": True,
    "raw_eqres_rel": True,
    "raw_eqres_paper": True,
    "eqres_disp": False,
    "volume_error_mean": True,
    "skin_error_mean": True,
}


def bounds_caption(methods: Iterable[str]) -> str:
    """What the bounds among the methods are."""
    known = (f"{written(name)}: {BOUNDS[name]}." for name in methods if name in BOUNDS)
    return " ".join(["What no method can know, measured as the methods are and never tested.", *known])


def _summaries() -> list[Column]:
    columns = []
    for name, spread in SUMMARISED.items():
        source = BY_NAME[name]
        columns.append(number(f"{name}_mean", source.unit, f"mean of {name}", source.summary))
        if spread:
            columns.append(number(f"{name}_sd", source.unit, f"standard deviation of {name}", source.summary))
    return columns


COMPARISON = (
    Column("method", str, "", "method"),
    Column("reference", bool, "", "whether the others are tested against it"),
    Column("bound", bool, "", "whether it knows the outcome and bounds the methods; never tested"),
    Column("n", int, "", "patients with a metric"),
    Column("failed", int, "", "patients without a metric or without convergence"),
    *_summaries(),
    number("hdmax_worst", "mm", "largest hdmax of a patient"),
    number("apart_worst", "mm", "largest apart of a patient"),
    number("flagged", "", f"patients with apart above {FLAGGED:g} mm", ".0f"),
    number("inverted", "", "inverted elements over all patients", ".0f"),
    number("explained", "", f"(cd of {BASELINE} - cd) / (cd of {BASELINE} - cd of {FLOOR}), of means", ".3f"),
    number("of_ceiling", "", f"(cd of {BASELINE} - cd) / (cd of {BASELINE} - cd of {CEILING}), of means", ".3f"),
    number("explained_low", "", "end of the bootstrap 95% interval of explained", ".3f"),
    number("explained_high", "", "end of the bootstrap 95% interval of explained", ".3f"),
    number("pairs", "", "patients that the test compares", ".0f"),
    number("cd_median_difference", "mm", "median of cd minus the reference's"),
    number("cd_mean_difference", "mm", "mean of cd minus the reference's"),
    number("cd_low", "mm", "end of the bootstrap 95% interval of the mean difference"),
    number("cd_high", "mm", "end of the bootstrap 95% interval of the mean difference"),
    number("p", "", "two-sided Wilcoxon signed-rank test of cd", ".6g"),
    number("p_holm", "", "p after Holm's correction over the methods", ".6g"),
    Column("test", str, "", "how p was made, or why there is none"),
)
_COMPARISON = {column.name: column for column in COMPARISON}
# Text of a row of COMPARISON: the explained share with its interval.
share = with_interval(COMPARISON, "explained", "explained_low", "explained_high")
# The paired difference to BASELINE that the pictures of settings and corrections show.
AGAINST_BASELINE = (
    number("sliding_difference", "mm", f"mean of cd minus that of {BASELINE} on the same patients"),
    number("sliding_low", "mm", "end of the bootstrap 95% interval of sliding_difference"),
    number("sliding_high", "mm", "end of the bootstrap 95% interval of sliding_difference"),
)


def summarise(
    cases: pd.DataFrame,
    reference: str | None = "pinnochio",
    methods: Sequence[str] | None = None,
    seed: int = 0,
    bounds: Sequence[str] = (),
) -> pd.DataFrame:
    """One row per method (in the order of `methods`, else by name), then per bound: the COMPARISON columns, tested on
    cd.

    A patient without cd (failed prediction) counts as failed and is left out of that method's means; the
    test takes the patients that both methods have, the explained share those that BASELINE and FLOOR have too. Without
    a reference nothing is tested, without these two nothing explained.
    """
    cases = check(cases, CASES)
    if cases.duplicated(["case", "method"]).any():
        raise InputError("-", "cases", "a case appears twice for one method", "keep one row per case and method")
    methods = list(methods) if methods is not None else sorted(set(cases["method"]) - set(bounds))
    if unknown := [
        method for method in [*methods, *bounds, reference] if method and method not in set(cases["method"])
    ]:
        raise InputError("-", "cases", f"method {unknown[0]!r} has no row", "predict and evaluate it first")
    rows, errors = [], cases.pivot(index="case", columns="method", values="cd")
    for method in [*methods, *bounds]:
        group = cases[cases["method"] == method]
        row = {"method": method, "reference": method == reference, "bound": method in bounds}
        row["n"] = int(group["cd"].notna().sum())
        row["failed"] = int((group["cd"].isna() | ~group["converged"]).sum())
        for name, spread in SUMMARISED.items():
            row[f"{name}_mean"] = group[name].mean()
            if spread:
                row[f"{name}_sd"] = group[name].std()
        row |= {f"{name}_worst": group[name].max() for name in ("hdmax", "apart")}
        row["flagged"] = np.nan if method in bounds else (group["apart"] > FLAGGED).sum()
        row["inverted"] = group["inverted"].sum()
        if {BASELINE, FLOOR} <= set(errors):
            common = errors[list(dict.fromkeys([method, BASELINE, FLOOR]))].dropna()
            share = explained(common[method], common[BASELINE], common[FLOOR], derive_seed(seed, "explained", method))
            row |= {"explained": share.share, "explained_low": share.low, "explained_high": share.high}
        if {BASELINE, CEILING} <= set(errors):
            row["of_ceiling"] = float(of_means(errors[[method, BASELINE, CEILING]].dropna().mean()))
        test = paired(cases, "cd", method, reference, derive_seed(seed, "bootstrap", method), bounds)
        row |= {"pairs": test.n, "cd_median_difference": test.median, "cd_mean_difference": test.mean}
        row |= {"cd_low": test.low, "cd_high": test.high, "p": test.p, "test": test.statement}
        rows.append(row)
    frame = pd.DataFrame(rows).reindex(columns=[column.name for column in COMPARISON])
    frame["p_holm"] = holm(frame["p"])
    return check(frame, COMPARISON)


def paired(
    cases: pd.DataFrame, measure: str, method: str, reference: str | None, seed: int, bounds: Sequence[str] = ()
) -> Comparison:
    """A method against the reference by one column of CASES, over the patients that both have.

    Of the reference itself, of a bound, or without a reference, nothing but a statement.
    """
    if method in bounds:
        return Comparison.none("bound: not tested")
    if method == reference or reference is None:
        return Comparison.none("reference" if reference else "no reference: not tested")
    errors = cases.pivot(index="case", columns="method", values=measure)[[method, reference]].dropna()
    return compare(errors[method], errors[reference], seed)


def by_patient(tested: pd.DataFrame, reference: pd.DataFrame, seed: int) -> Comparison:
    """`cd` of rows with one `case` each against that of others, over the patients that both have."""
    both = pd.concat([rows.set_index("case")["cd"] for rows in (tested, reference)], axis=1, keys=("one", "other"))
    both = both.dropna()
    return compare(both["one"], both["other"], seed)


def against_baseline(tested: pd.DataFrame, baseline: pd.DataFrame, seed: int) -> dict:
    """The cells of AGAINST_BASELINE; empty where nothing can be compared."""
    test = by_patient(tested, baseline, seed)
    return {"sliding_difference": test.mean, "sliding_low": test.low, "sliding_high": test.high}


def count(n: pd.Series) -> str:
    """How many patients the rows of a table have, as captions say it."""
    return f"n = {n.min()}" if n.nunique() == 1 else f"n = {n.min()} to {n.max()}"


def spread(name: str, columns: Mapping[str, Column] = _COMPARISON) -> Callable:
    """Text of a row of these columns, by name: mean and standard deviation of a summarised one."""

    def text(row) -> str:
        mean, sd = (columns[f"{name}_{part}"].text(row[f"{name}_{part}"]) for part in ("mean", "sd"))
        return f"{mean} ± {sd}" if sd else mean

    return text


def worst_point(row) -> str:
    """Text of a row of COMPARISON: the largest distance, mean and worst patient, and in how many patients a point is
    far from every other method's."""
    mean, worst = (_COMPARISON[name].text(row[name]) for name in ("hdmax_mean", "hdmax_worst"))
    return f"{mean}, worst {worst}" + (f" ! {row['flagged']:.0f}" if row["flagged"] > 0 else "")


def starred(text: Callable) -> Callable:
    """The text of a row with a star where Holm's p is below 0.05."""
    return lambda row: text(row) + ("*" if row["p_holm"] < 0.05 else "")


def significance(row) -> str:
    """Text of a row of COMPARISON: Holm's p, or why there is none."""
    return row["test"] if np.isnan(row["p_holm"]) else _COMPARISON["p_holm"].text(row["p_holm"])
