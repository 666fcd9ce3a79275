"""The errors on each region of the face."""

from functools import partial

from pinnochio.metrics.region_errors import REGIONS
from pinnochio.tables.places import Group, Place, of_places

GROUPS = (
    Group(
        [Place(name, f"region_{name}", f"bias_{name}") for name in REGIONS],
        "Distance of the target's points from the prediction by region of the face",
    ),
)

tabulate = partial(of_places, GROUPS)
