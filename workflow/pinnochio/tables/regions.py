"""The tables by place: errors on each region of the face, and at landmarks and throughout the virtual truth."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pinnochio.metrics.regions import LANDMARKS, REGIONS
from pinnochio.seeds import derive_seed
from pinnochio.statistics.significance import holm
from pinnochio.tables.accuracy import count, paired, starred
from pinnochio.tables.engine import CASES, Block, Column, View, check, number, words, write_csv, write_twins


def _number(name: str, description: str, form: str = ".4f", unit: str = "mm") -> Column:
    return number(name, unit, description, form)


PLACES = (
    Column("method", str, "", "method"),
    Column("place", str, "", "region, landmark, or what of the whole field"),
    Column("reference", bool, "", "whether the others are tested against this method"),
    Column("n", int, "", "patients with an error there"),
    _number("mean", "mean error over the patients"),
    _number("sd", "standard deviation of it"),
    _number("bias", "mean signed error of a region: positive where the prediction lies outside the target"),
    _number("pairs", "patients that the test compares", ".0f", ""),
    _number("difference", "mean error minus the reference's"),
    _number("low", "lower end of the bootstrap 95% interval of that mean"),
    _number("high", "upper end of it"),
    _number("p", "two-sided Wilcoxon signed-rank test of the error", ".6g", ""),
    _number("p_holm", "p after Holm's correction over the methods, at this place", ".6g", ""),
    Column("test", str, "", "how p came about, or why there is none"),
)
_PLACES = {column.name: column for column in PLACES}


@dataclass(frozen=True)
class Place:
    """What a row is about: a name and the column of CASES with its error, and with its signed error if it has one."""

    name: str
    error: str
    bias: str | None = None


@dataclass(frozen=True)
class Kind:
    """A table: its places in the groups that the readable twins show one below the other, and what they are."""

    groups: tuple[tuple[Place, ...], ...]
    captions: tuple[str, ...]
    titles: tuple[str, ...] = ("",)

    @property
    def places(self) -> list[Place]:
        return [place for group in self.groups for place in group]


KINDS = {
    "regions": Kind(
        (tuple(Place(name, f"region_{name}", f"bias_{name}") for name in REGIONS),),
        ("Distance of the target's points from the prediction by region of the face",),
    ),
    "landmarks": Kind(
        (
            tuple(Place(name, f"landmark_{name}") for name in LANDMARKS),
            tuple(
                Place(f"{part}{suffix}", f"{part}_error_{key}")
                for part in ("skin", "volume")
                for suffix, key in (("", "mean"), ("_p95", "p95"))
            ),
        ),
        (
            "Error of the predicted displacement at landmarks against the virtual truth",
            "Error against the virtual truth over the skin and over the tissue, mean and 95th percentile of a patient "
            "(blank for methods that predict the skin alone)",
        ),
        ("", "Skin and volume"),
    ),
}


def summarise_places(
    cases: pd.DataFrame, places: Sequence[Place], reference: str | None, methods: Sequence[str], seed: int = 0
) -> pd.DataFrame:
    """One row of PLACES per method and place, each tested against the reference over the patients of both.

    Without a reference nothing is tested.
    """
    cases = check(cases, CASES)
    rows = []
    for method in methods:
        own = cases[cases["method"] == method]
        for place in places:
            found = paired(
                cases, place.error, method, reference, derive_seed(seed, "bootstrap", f"{place.error}/{method}")
            )
            rows.append(
                {
                    "method": method,
                    "place": place.name,
                    "reference": method == reference,
                    "n": int(own[place.error].notna().sum()),
                    "mean": own[place.error].mean(),
                    "sd": own[place.error].std(),
                    "bias": own[place.bias].mean() if place.bias else np.nan,
                    "pairs": found.n,
                    "difference": found.mean,
                    "low": found.low,
                    "high": found.high,
                    "p": found.p,
                    "test": found.statement,
                }
            )
    frame = pd.DataFrame(rows)
    frame["p_holm"] = frame.groupby("place")["p"].transform(holm)
    return check(frame, PLACES)


def write_places(frame: pd.DataFrame, path: str | os.PathLike, kind: Kind, cohort: str = "virtual cohort") -> None:
    """Write the CSV and its twins: one row per method, one column per place; signed errors below, where there are."""
    frame = write_csv(frame, path, PLACES)
    reference = ", ".join(frame.loc[frame["reference"], "method"].unique()) or "the reference"
    n = count(frame.loc[frame["n"] > 0, "n"]) if frame["n"].any() else "n = 0"
    cells = frame.set_index(["place", "method"])
    by_method = pd.DataFrame({"method": frame["method"].unique()})

    def column(place: Place, text, sign: int) -> View:
        return View(words(place.name), lambda row: text(cells.loc[(place.name, row["method"])]), sign)

    method = View("Method", lambda row: row["method"])
    blocks = [
        Block(
            by_method,
            [method, *(column(place, starred(_spread), -1) for place in group)],
            f"{what} in mm, {cohort}, {n} patients: mean ± standard deviation. Bold: best mean. * p < 0.05: two-sided "
            f"Wilcoxon signed-rank test against {reference}, Holm-corrected per column.",
            title,
        )
        for group, what, title in zip(kind.groups, kind.captions, kind.titles, strict=True)
    ]
    signed = [place for place in kind.places if place.bias]
    if signed:
        blocks.append(
            Block(
                by_method,
                [method, *(column(place, lambda row: _signed(row["bias"]), 0) for place in signed)],
                "Mean signed distance in mm: positive where the prediction lies outside the target.",
                "Signed",
            )
        )
    first, *further = blocks
    write_twins(first.frame, path, first.view, first.caption, PLACES, further)


def _spread(row) -> str:
    return " ± ".join(filter(None, (_PLACES[name].text(row[name]) for name in ("mean", "sd"))))


def _signed(value: float) -> str:
    return "" if np.isnan(value) else f"{value:+.4f}"
