"""The plain values of a scene's decisions."""

from collections.abc import Sequence
from dataclasses import dataclass

REDUCTIONS = ("region", "bonded", "single_layer", "graded", "elastic")


@dataclass(frozen=True)
class SceneSettings:
    """Each reduction "auto", or whether it is made; segments "auto" or the names of those that are followed.

    amplitude (mm): tissue that moves less is left out; still (mm): a segment that moves less stays; elastic_motion
    (mm): bone that moves at most so far is left to linear elasticity.
    """

    region: str | bool = "auto"
    bonded: str | bool = "auto"
    single_layer: str | bool = "auto"
    graded: str | bool = "auto"
    elastic: str | bool = "auto"
    segments: str | Sequence[str] = "auto"
    amplitude: float = 0.02
    still: float = 0.1
    elastic_motion: float = 2.0
