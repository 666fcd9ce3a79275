"""Errors by place, a region of the face or a landmark: what the tables of both share."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number, read_table, words
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.seeds import derive_seed
from pinnochio.statistics.wilcoxon import holm
from pinnochio.tables.comparison import bounds_caption, count, paired, starred
from pinnochio.tables.document import Block, Table, View, views


def _number(name: str, description: str, form: str = ".4f", unit: str = "mm") -> Column:
    return number(name, unit, description, form)


PLACES = (
    Column("method", str, "", "method"),
    Column("place", str, "", "region, landmark, or part of the whole field"),
    Column("reference", bool, "", "whether the others are tested against it"),
    Column("bound", bool, "", "whether it knows the outcome and bounds the methods; never tested"),
    Column("n", int, "", "patients with an error there"),
    _number("mean", "mean error"),
    _number("sd", "standard deviation of the error"),
    _number("bias", "mean signed error of a region, positive where the prediction lies outside"),
    _number("pairs", "patients that the test compares", ".0f", ""),
    _number("difference", "mean error minus the reference's"),
    _number("low", "end of the bootstrap 95% interval of difference"),
    _number("high", "end of the bootstrap 95% interval of difference"),
    _number("p", "two-sided Wilcoxon signed-rank test of the error", ".6g", ""),
    _number("p_holm", "p after Holm's correction over the methods at this place", ".6g", ""),
    Column("test", str, "", "how p was made, or why there is none"),
)
_PLACES = {column.name: column for column in PLACES}


@dataclass(frozen=True)
class Place:
    """What a row is about: a name and the column of CASES with its error, and with its signed error if it has one."""

    name: str
    error: str
    bias: str | None = None


@dataclass(frozen=True)
class Group:
    """Places that the readable twins show in one block, and what it says of them."""

    places: Sequence[Place]
    caption: str
    title: str = ""


def of_places(
    groups: Sequence[Group],
    cases: str | os.PathLike,
    methods: Sequence[str],
    bounds: Sequence[str],
    reference: str | None,
    cohort: str,
    seed: int,
) -> Table:
    """The scanned patients of cases.csv by method, then bound, and place, tested against the reference."""
    rows = scanned(read_table(cases, CASES))
    places = [place for group in groups for place in group.places]
    return table(summarise(rows, places, reference, methods, seed, bounds), groups, cohort)


def summarise(
    cases: pd.DataFrame,
    places: Sequence[Place],
    reference: str | None,
    methods: Sequence[str],
    seed: int = 0,
    bounds: Sequence[str] = (),
) -> pd.DataFrame:
    """One row of PLACES per method, then bound, and place, each method tested against the reference over the patients
    of both.

    Without a reference nothing is tested.
    """
    cases = check(cases, CASES)
    rows = []
    for method in [*methods, *bounds]:
        part = cases[cases["method"] == method]
        for place in places:
            drawn = derive_seed(seed, "bootstrap", f"{place.error}/{method}")
            test = paired(cases, place.error, method, reference, drawn, bounds)
            rows.append(
                {
                    "method": method,
                    "place": place.name,
                    "reference": method == reference,
                    "bound": method in bounds,
                    "n": int(part[place.error].notna().sum()),
                    "mean": part[place.error].mean(),
                    "sd": part[place.error].std(),
                    "bias": part[place.bias].mean() if place.bias else np.nan,
                    "pairs": test.n,
                    "difference": test.mean,
                    "low": test.low,
                    "high": test.high,
                    "p": test.p,
                    "test": test.statement,
                }
            )
    frame = pd.DataFrame(rows)
    frame["p_holm"] = frame.groupby("place")["p"].transform(holm)
    return check(frame, PLACES)


def table(frame: pd.DataFrame, groups: Sequence[Group], cohort: str) -> Table:
    """The table of rows of PLACES, in the twins one row per method and one column per place; bounds below the
    methods, and signed errors below all."""
    reference = ", ".join(frame.loc[frame["reference"], "method"].unique()) or "the reference"
    n = count(frame.loc[frame["n"] > 0, "n"]) if frame["n"].any() else "n = 0"
    cells = frame.set_index(["place", "method"])
    every, bounds = (pd.DataFrame({"method": part["method"].unique()}) for part in (frame, frame[frame["bound"]]))
    methods = every[~every["method"].isin(bounds["method"])]

    def block(rows: pd.DataFrame, places: Sequence[Place], text, sign: int, caption: str, title: str) -> Block:
        def view(place: Place) -> View:
            return View(words(place.name), lambda row: text(cells.loc[(place.name, row["method"])]), sign)

        method = views(PLACES, {"method": "Method"})
        return Block.of(rows, [*method, *(view(place) for place in places)], caption, title)

    tested = (
        f" in mm, {cohort}, {n} patients: mean ± standard deviation. Bold: best mean. * p < 0.05: two-sided "
        f"Wilcoxon signed-rank test against {reference}, Holm-corrected per column."
    )
    blocks = []
    for group in groups:
        blocks.append(block(methods, group.places, starred(_spread), -1, group.caption + tested, group.title))
        if len(bounds):
            title = f"{group.title}: bounds" if group.title else "Bounds"
            blocks.append(block(bounds, group.places, _spread, 0, bounds_caption(bounds["method"]), title))
    if signed := [place for group in groups for place in group.places if place.bias]:
        caption = "Mean signed distance in mm: positive where the prediction lies outside the target."
        blocks.append(block(every, signed, lambda row: _signed(row["bias"]), 0, caption, "Signed"))
    return Table(frame, PLACES, blocks)


def _spread(row) -> str:
    return " ± ".join(filter(None, (_PLACES[name].text(row[name]) for name in ("mean", "sd"))))


def _signed(value: float) -> str:
    return "" if np.isnan(value) else f"{value:+.4f}"
