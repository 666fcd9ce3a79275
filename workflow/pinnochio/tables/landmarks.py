"""The errors at landmarks, over the skin and throughout the tissue, of the virtual cohort, whose truth is known."""

import os
from collections.abc import Sequence

from pinnochio.columns import read_table
from pinnochio.metrics.columns import CASES, scanned
from pinnochio.metrics.regions import LANDMARKS
from pinnochio.tables.document import Table
from pinnochio.tables.places import Group, Place, summarise, table

GROUPS = (
    Group(
        [Place(name, f"landmark_{name}") for name in LANDMARKS],
        "Error of the predicted displacement at landmarks against the virtual truth",
    ),
    Group(
        [
            Place(f"{part}{suffix}", f"{part}_error_{key}")
            for part in ("skin", "volume")
            for suffix, key in (("", "mean"), ("_p95", "p95"))
        ],
        "Error against the virtual truth over the skin and over the tissue, mean and 95th percentile of a patient "
        "(blank for methods that predict the skin alone)",
        "Skin and volume",
    ),
)


def tabulate(
    cases: str | os.PathLike,
    methods: Sequence[str],
    bounds: Sequence[str],
    reference: str | None,
    cohort: str,
    seed: int,
) -> Table:
    """The scanned patients of cases.csv by method, then bound, and place, tested against the reference."""
    rows = scanned(read_table(cases, CASES))
    places = [place for group in GROUPS for place in group.places]
    return table(summarise(rows, places, reference, methods, seed, bounds), GROUPS, cohort)
