"""The errors on each region of the face."""

from functools import partial

from pinnochio.metrics.region_errors import SHOWN
from pinnochio.tables.places import Group, Place, of_places

GROUPS = (
    Group(
        [Place(name, f"region_{name}", f"bias_{name}") for name in SHOWN],
        "Distance of the target's points from the prediction by region of the face; the neck, below the jaw, counts in "
        "no other table",
    ),
)

tabulate = partial(of_places, GROUPS)
