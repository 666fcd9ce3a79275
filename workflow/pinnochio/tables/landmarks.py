"""The errors at landmarks, over the skin and throughout the tissue, of the virtual cohort, whose truth is known."""

from functools import partial

from pinnochio.metrics.region_errors import LANDMARKS
from pinnochio.tables.places import Group, Place, of_places

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

tabulate = partial(of_places, GROUPS)
