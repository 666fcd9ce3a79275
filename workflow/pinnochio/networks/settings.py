"""Sizes of the networks."""

from dataclasses import dataclass

LIFTS = ("none",)


@dataclass(frozen=True)
class NetworkSettings:
    """Plain values that fix the architecture; stored with every trained model.

    Layers of the interface encoders and of the two branches of the volume networks (boundary signal and rest
    geometry); channels and heads of the graph attention; nearest source nodes that an interface node pools;
    width of the decoders. `decomposition` off gives the unified network, one graph network over the whole
    tissue fed the reference cue alone. `lift` says what the free nodes of the sparse boundary signal carry:
    "none" is zero, as in the paper.
    """

    boundary_layers: int = 3
    volume_layers: int = 6
    rest_layers: int = 2
    channels: int = 64
    heads: int = 4
    neighbours: int = 8
    decoder_width: int = 128
    decomposition: bool = True
    lift: str = "none"

    def __post_init__(self):
        if self.channels % self.heads:
            raise ValueError(f"channels {self.channels} are not a multiple of heads {self.heads}")
        if self.lift not in LIFTS:
            raise ValueError(f"lift {self.lift!r} is not one of {LIFTS}")
