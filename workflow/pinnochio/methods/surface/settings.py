"""Sizes and switches of the surface networks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

ARCHITECTURES = ("acmt", "fscnet", "dgcfp")


@dataclass(frozen=True)
class SurfaceSettings:
    """Plain values that fix a surface network and what it reads; stored with every trained one.

    The layer widths are the published code's and are not settings. points: drawn from the skin and from the bone, 4096
    in the published code; every level of an encoder holds the same share of them as there. neighbours: at most so many
    points in a ball, 64 there. repeats: draws of each patient, shown in turn. mixed_precision: on a GPU
    matrix products in bfloat16, as DGCFP is trained in half precision. REMOVED: as of NetworkSettings.
    """

    REMOVED: ClassVar[Mapping[str, object]] = {"distance_guided": 0}

    architecture: str
    points: int
    neighbours: int
    repeats: int
    mixed_precision: bool = False

    def __post_init__(self):
        if self.architecture not in ARCHITECTURES:
            raise ValueError(f"architecture {self.architecture!r} is not one of {ARCHITECTURES}")
        if self.points < 64:
            raise ValueError(f"{self.points} points are too few: 64 at least")
