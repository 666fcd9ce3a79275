"""The errors on each region of the face."""

import os
from collections.abc import Sequence

from pinnochio.columns import read_table
from pinnochio.metrics.columns import CASES, scanned
from pinnochio.metrics.regions import REGIONS
from pinnochio.tables.document import Table
from pinnochio.tables.places import Group, Place, summarise, table

GROUPS = (
    Group(
        [Place(name, f"region_{name}", f"bias_{name}") for name in REGIONS],
        "Distance of the target's points from the prediction by region of the face",
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
    """The scanned patients of cases.csv by method, then bound, and region, tested against the reference."""
    rows = scanned(read_table(cases, CASES))
    places = [place for group in GROUPS for place in group.places]
    return table(summarise(rows, places, reference, methods, seed, bounds), GROUPS, cohort)
