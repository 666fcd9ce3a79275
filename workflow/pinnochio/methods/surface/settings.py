"""Sizes and switches of the surface networks."""

from dataclasses import dataclass

ARCHITECTURES = ("acmt", "fscnet", "dgcfp")


@dataclass(frozen=True)
class SurfaceSettings:
    """Plain values that fix a surface network and what it reads; stored with every trained one.

    The layer widths are the published code's and are not settings. points: drawn from the skin and from the bone, 4096
    in the published code; every level of an encoder holds the same share of them as there. neighbours: at most so many
    points in a ball, 64 there. repeats: draws of each patient, shown in turn.

    softmax (acmt): the weights of the attention over the bone add up to one; the published code divides by the number
    of bone points. distance_guided (fscnet): mm over which the weight of a skin point falls with its distance from the
    moving bone, 0 for equal weights. contrast (acmt): weight of the contrastive term in pretraining, a reconstruction.
    mixed_precision: matrix products in bfloat16, as DGCFP is trained in half precision.
    """

    architecture: str
    points: int
    neighbours: int
    repeats: int
    softmax: bool = False
    distance_guided: float = 0.0
    contrast: float = 0.0
    mixed_precision: bool = False

    def __post_init__(self):
        if self.architecture not in ARCHITECTURES:
            raise ValueError(f"architecture {self.architecture!r} is not one of {ARCHITECTURES}")
        if self.points < 64:
            raise ValueError(f"{self.points} points are too few: 64 at least")
        for switch, owner in (("softmax", "acmt"), ("contrast", "acmt"), ("distance_guided", "fscnet")):
            if getattr(self, switch) and self.architecture != owner:
                raise ValueError(f"{switch!r} belongs to {owner!r}, not to {self.architecture!r}")
