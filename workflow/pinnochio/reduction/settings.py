"""The settings of model reduction."""

from collections.abc import Sequence
from dataclasses import dataclass

REDUCTIONS = ("region", "bonded", "single_layer", "graded", "elastic")


@dataclass(frozen=True)
class SceneSettings:
    """Each reduction "auto", or whether it is made; segments "auto" or the names of those that are followed.

    amplitude (mm): tissue that moves less is left out; still (mm): a segment that moves less stays; elastic_motion
    (mm): bone that moves at most so far is left to linear elasticity.
    """

    region: str | bool
    bonded: str | bool
    single_layer: str | bool
    graded: str | bool
    elastic: str | bool
    segments: str | Sequence[str]
    amplitude: float
    still: float
    elastic_motion: float
