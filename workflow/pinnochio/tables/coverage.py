"""The table of coverage: how much of each region, and how many measures, lie within the half-width, by method."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import Column, number, read_tables, words
from pinnochio.tables.document import Block, Table, View, views

COVERAGE = (
    Column("method", str, "", "method that predicted"),
    Column("region", str, "", "region of the judged face, or a measure; face, measures: all, each by its half-width"),
    Column("unit", str, "", "of errors and half-widths"),
    Column("level", float, "%", "share that the half-width should cover", ".1f"),
    Column("n", int, "", "patients with points in the region, each held out once"),
    number("points", "", "mean points of a patient in the region", ".0f"),
    number("error_mean", "of the row", "mean distance from the outcome, held-out patients weighed equally", ".3f"),
    number("coverage_mean", "%", "points, or patients, within the half-width of the other folds", ".2f"),
    number("coverage_sd", "%", "standard deviation of coverage over patients", ".2f"),
    number("coverage_low", "%", "end of the bootstrap 95% interval of coverage", ".2f"),
    number("coverage_high", "%", "end of the bootstrap 95% interval of coverage", ".2f"),
    number("half_width", "of the row", "half-width calibrated on all patients", ".3f"),
    number("half_width_low", "of the row", "smallest half-width calibrated without one fold", ".3f"),
    number("half_width_high", "of the row", "largest half-width calibrated without one fold", ".3f"),
)


def tabulate(parts: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The tables of the methods, one after the other."""
    return table(read_tables(parts, COVERAGE), cohort)


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """The table of rows of COVERAGE."""
    column = {c.name: c for c in COVERAGE}

    def pair(first, between, second):
        return lambda row: between.join(filter(None, (column[name].text(row[name]) for name in (first, second))))

    view = [
        *views(COVERAGE, {"method": "Method"}),
        View("Region or measure", lambda row: words(row["region"])),
        *views(COVERAGE, {"n": "n", "unit": "Unit", "error_mean": "Mean error"}),
        View("Coverage %", pair("coverage_mean", " ± ", "coverage_sd")),
        View("95% interval of the mean", pair("coverage_low", " to ", "coverage_high")),
        *views(COVERAGE, {"half_width": "Half-width"}),
        View("over folds", pair("half_width_low", " to ", "half_width_high")),
    ]
    level = ", ".join(sorted({column["level"].text(value) for value in frame["level"]}))
    caption = (
        f"Coverage on the {cohort} at {level} %: points and measures of held-out patients, predicted from the plan "
        "(once, where a method predicts once), within half-widths calibrated on the other folds, mean ± standard "
        "deviation over patients; empty where these are too few. The half-width is that of all patients."
    )
    return Table(frame, COVERAGE, [Block.of(frame, view, caption)])
