"""The dial's table: what each number of Newton corrections makes of a learned method's predictions."""

import os
from collections.abc import Mapping

import numpy as np
import pandas as pd

from pinnochio.errors import InputError
from pinnochio.seeds import derive_seed
from pinnochio.statistics.significance import compare, holm
from pinnochio.tables.accuracy import count, spread
from pinnochio.tables.engine import CASES, Column, View, check, write_csv, write_twins

AVERAGED = ("cd", "pwr1", "volume_error_mean", "eqres_rel", "min_jacobian", "interface_error", "seconds")
_CASE = {column.name: column for column in CASES}


def _column(name: str, of: str, description: str) -> Column:
    return Column(name, float, _CASE[of].unit, description, _CASE[of].summary, optional=True)


CORRECTIONS = (
    Column("method", str, "", "learned method whose predictions are corrected"),
    Column("corrections", int, "", "Newton corrections; 0 is the method's own prediction"),
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
    _column("cd_low", "cd", "lower end of the bootstrap 95% interval of that mean"),
    _column("cd_high", "cd", "upper end of it"),
    Column("p", float, "", "two-sided Wilcoxon signed-rank test of cd against no correction", ".6g", optional=True),
    Column("p_holm", float, "", "p after Holm's correction over the method's corrections", ".6g", optional=True),
    Column("test", str, "", "how p came about, or why there is none"),
)
_CORRECTIONS = {column.name: column for column in CORRECTIONS}


def summarise(rows: Mapping[tuple[str, int], pd.DataFrame], seed: int = 0) -> pd.DataFrame:
    """One row of CORRECTIONS per method and number of corrections, in the order given, of the CASES rows of its patients.

    Every method needs its rows without correction, which the others are compared with, patient by patient.
    """
    found = []
    for (method, corrections), cases in rows.items():
        if (method, 0) not in rows:
            raise InputError("-", "corrections", f"{method!r} has no rows without correction", "add its own metrics")
        own = check(cases, CASES)
        row = {"method": method, "corrections": corrections, "n": len(own)}
        for name in AVERAGED:
            row |= {f"{name}_mean": own[name].mean(), f"{name}_sd": own[name].std()}
        row |= {"eqres_rel_max": own["eqres_rel"].max(), "min_jacobian_min": own["min_jacobian"].min()}
        row |= {"inverted": own["inverted"].sum()}
        row |= dict.fromkeys(("pairs", "cd_difference", "cd_low", "cd_high", "p"), np.nan)
        row["test"] = "reference"
        if corrections:
            both = own.set_index("case")["cd"], rows[method, 0].set_index("case")["cd"]
            both = pd.concat(both, axis=1, keys=("own", "reference")).dropna()
            test = compare(both["own"], both["reference"], derive_seed(seed, "bootstrap", f"{method}/{corrections}"))
            row |= {"pairs": test.n, "cd_difference": test.mean, "cd_low": test.low, "cd_high": test.high}
            row |= {"p": test.p, "test": test.statement}
        found.append(row)
    frame = pd.DataFrame(found)
    frame["p_holm"] = frame.groupby("method")["p"].transform(holm)
    return check(frame, CORRECTIONS)


def write_corrections(frame: pd.DataFrame, path: str | os.PathLike, cohort: str = "virtual cohort") -> None:
    """Write corrections.csv and its twins."""
    frame = write_csv(frame, path, CORRECTIONS)

    def one(name):
        return lambda row: _CORRECTIONS[name].text(row[name])

    def difference(row):
        if np.isnan(row["cd_difference"]):
            return ""
        p = f"p = {one('p_holm')(row)}" if not np.isnan(row["p_holm"]) else row["test"]
        return f"{row['cd_difference']:+.4f} ({p})"

    view = [
        View("Method", one("method")),
        View("Corrections", one("corrections")),
        View("CD mm", spread("cd", _CORRECTIONS)),
        View("CD difference mm", difference),
        View("PWR@1 %", spread("pwr1", _CORRECTIONS)),
        View("Volume error mm", spread("volume_error_mean", _CORRECTIONS)),
        View("EqRes", one("eqres_rel_mean")),
        View("largest EqRes", one("eqres_rel_max")),
        View("min J", spread("min_jacobian", _CORRECTIONS)),
        View("Inverted", one("inverted")),
        View("Seconds", spread("seconds", _CORRECTIONS)),
    ]
    caption = (
        f"Newton corrections of the networks' fields on their own interface, {cohort}, {count(frame['n'])} patients: "
        "mean ± standard deviation. CD difference: mean change against no correction, two-sided Wilcoxon signed-rank "
        "test, Holm-corrected per method. EqRes: residual of the free nodes over the force of all others. Seconds: "
        "network and corrections."
    )
    write_twins(frame, path, view, caption, CORRECTIONS)
