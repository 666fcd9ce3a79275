"""The table of corrections: what each number of Newton corrections makes of a learned method's predictions."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.errors import InputError
from pinnochio.metrics.case_columns import BY_NAME, CASES
from pinnochio.seeds import derive_seed
from pinnochio.statistics.wilcoxon import holm
from pinnochio.tables.comparison import AGAINST_BASELINE, against_baseline, by_patient, count, spread
from pinnochio.tables.document import Block, Table, View, views

AVERAGED = ("cd", "pwr1", "volume_error_mean", "eqres_rel", "min_jacobian", "interface_error", "seconds")


def _column(name: str, of: str, description: str) -> Column:
    return number(name, BY_NAME[of].unit, description, BY_NAME[of].summary)


CORRECTIONS = (
    Column("method", str, "", "corrected learned method"),
    Column("corrections", int, "", "Newton corrections; 0: none"),
    Column("n", int, "", "patients"),
    *(
        _column(f"{name}_{part}", name, f"{word} of {name}")
        for name in AVERAGED
        for part, word in (("mean", "mean"), ("sd", "standard deviation"))
    ),
    _column("eqres_rel_max", "eqres_rel", "largest eqres_rel of a patient"),
    _column("min_jacobian_min", "min_jacobian", "smallest min_jacobian of a patient"),
    _column("inverted", "inverted", "inverted elements over all patients"),
    _column("pairs", "inverted", "patients that the test compares"),
    _column("cd_difference", "cd", "mean of cd minus that without correction"),
    _column("cd_low", "cd", "end of the bootstrap 95% interval of cd_difference"),
    _column("cd_high", "cd", "end of the bootstrap 95% interval of cd_difference"),
    number("p", "", "two-sided Wilcoxon signed-rank test of cd against no correction", ".6g"),
    number("p_holm", "", "p after Holm's correction over the method's corrections", ".6g"),
    Column("test", str, "", "how p was made, or why there is none"),
    *AGAINST_BASELINE,
)
_CORRECTIONS = {column.name: column for column in CORRECTIONS}


def summarise(
    rows: Mapping[tuple[str, int], pd.DataFrame], seed: int = 0, baseline: pd.DataFrame | None = None
) -> pd.DataFrame:
    """One row of CORRECTIONS per method and number of corrections, in that order, of the CASES rows of its patients.

    Every method needs its rows without correction, which the others are compared with, patient by patient.
    baseline: CASES rows of BASELINE, if the study has it.
    """
    summaries = []
    for (method, corrections), cases in rows.items():
        if (method, 0) not in rows:
            raise InputError("-", "corrections", f"{method!r} has no rows without correction", "add its own metrics")
        group = check(cases, CASES)
        row = {"method": method, "corrections": corrections, "n": len(group)}
        for name in AVERAGED:
            row |= {f"{name}_mean": group[name].mean(), f"{name}_sd": group[name].std()}
        row |= {"eqres_rel_max": group["eqres_rel"].max(), "min_jacobian_min": group["min_jacobian"].min()}
        row |= {"inverted": group["inverted"].sum()}
        row |= dict.fromkeys(("pairs", "cd_difference", "cd_low", "cd_high", "p"), np.nan)
        row["test"] = "reference"
        draws = derive_seed(seed, "bootstrap", f"{method}/{corrections}")
        row |= against_baseline(group, group[:0] if baseline is None else baseline, draws)
        if corrections:
            test = by_patient(group, rows[method, 0], draws)
            row |= {"pairs": test.n, "cd_difference": test.mean, "cd_low": test.low, "cd_high": test.high}
            row |= {"p": test.p, "test": test.statement}
        summaries.append(row)
    frame = pd.DataFrame(summaries)
    frame["p_holm"] = frame.groupby("method")["p"].transform(holm)
    return check(frame, CORRECTIONS)


def tabulate(
    metrics: Sequence[str | os.PathLike],
    methods: Sequence[str],
    corrections: Sequence[int],
    cohort: str,
    seed: int,
    baseline: Sequence[str | os.PathLike] = (),
) -> Table:
    """The folds' metrics, method by method and, of each, number by number of corrections, 0 first.

    baseline: the folds' metrics of BASELINE, if the study has it.
    """
    keys = [(method, count) for method in methods for count in corrections]
    folds = len(metrics) // len(keys)
    rows = {key: read_tables(metrics[i * folds : (i + 1) * folds], CASES) for i, key in enumerate(keys)}
    return table(summarise(rows, seed, read_tables(baseline, CASES) if baseline else None), cohort)


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """The table of rows of CORRECTIONS."""

    def difference(row):
        if np.isnan(row["cd_difference"]):
            return ""
        p = row["test"] if np.isnan(row["p_holm"]) else f"p = {_CORRECTIONS['p_holm'].text(row['p_holm'])}"
        return f"{row['cd_difference']:+.4f} ({p})"

    view = [
        *views(CORRECTIONS, {"method": "Method", "corrections": "Corrections"}),
        View("CD mm", spread("cd", _CORRECTIONS)),
        View("CD difference mm", difference),
        View("PWR@1 %", spread("pwr1", _CORRECTIONS)),
        View("Volume error mm", spread("volume_error_mean", _CORRECTIONS)),
        *views(CORRECTIONS, {"eqres_rel_mean": "EqRes", "eqres_rel_max": "largest EqRes"}),
        View("min J", spread("min_jacobian", _CORRECTIONS)),
        *views(CORRECTIONS, {"inverted": "Inverted"}),
        View("Seconds", spread("seconds", _CORRECTIONS)),
    ]
    caption = (
        f"Newton corrections of the networks' fields on their own interface, {cohort}, {count(frame['n'])} patients: "
        "mean ± standard deviation. CD difference: mean change against no correction, two-sided Wilcoxon signed-rank "
        "test, Holm-corrected per method. EqRes: residual of the free nodes over the force of all others. Seconds: "
        "network and corrections."
    )
    return Table(frame, CORRECTIONS, [Block.of(frame, view, caption)])
