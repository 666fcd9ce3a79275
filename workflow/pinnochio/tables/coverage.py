"""The table of coverage: how much of each region lies within its half-width, by method."""

import os

import pandas as pd

from pinnochio.tables.engine import Column, View, number, write_csv, write_twins

COVERAGE = (
    Column("method", str, "", "method that predicted"),
    Column("region", str, "", "region of the judged face; face: all of them, each by its own half-width"),
    Column("level", float, "%", "share that the half-width shall cover", ".1f"),
    Column("n", int, "", "patients with points in the region, each held out once"),
    number("points", "", "mean number of such points of a patient", ".0f"),
    number("error_mean", "mm", "mean distance of a held-out point from the outcome, patients weighing equally", ".3f"),
    number("coverage_mean", "%", "points within the half-width of the other folds, mean over patients", ".2f"),
    number("coverage_sd", "%", "standard deviation over patients", ".2f"),
    number("coverage_low", "%", "lower end of the bootstrap 95% interval of that mean over patients", ".2f"),
    number("coverage_high", "%", "upper end of it", ".2f"),
    number("half_width", "mm", "half-width calibrated on all patients, for a new one", ".3f"),
    number("half_width_low", "mm", "smallest of the half-widths calibrated without one fold", ".3f"),
    number("half_width_high", "mm", "largest of them", ".3f"),
)


def write_coverage(frame: pd.DataFrame, path: str | os.PathLike, cohort: str = "virtual cohort") -> None:
    """Write coverage.csv and its twins beside it."""
    frame = write_csv(frame, path, COVERAGE)
    column = {c.name: c for c in COVERAGE}

    def text(name):
        return lambda row: column[name].text(row[name])

    def pair(first, between, second):
        return lambda row: between.join(filter(None, (text(first)(row), text(second)(row))))

    view = [
        View("Method", text("method")),
        View("Region", lambda row: row["region"].replace("_", " ")),
        View("n", text("n")),
        View("Mean error mm", text("error_mean")),
        View("Coverage %", pair("coverage_mean", " ± ", "coverage_sd")),
        View("95% interval of the mean", pair("coverage_low", " to ", "coverage_high")),
        View("Half-width mm", text("half_width")),
        View("over folds mm", pair("half_width_low", " to ", "half_width_high")),
    ]
    level = ", ".join(sorted({column["level"].text(value) for value in frame["level"]}))
    caption = (
        f"Coverage on the {cohort} at {level} %: points of held-out patients within half-widths calibrated on the "
        "other folds, mean ± standard deviation over patients; empty where these are too few. The half-width "
        "is that of all patients."
    )
    write_twins(frame, path, view, caption, COVERAGE)
