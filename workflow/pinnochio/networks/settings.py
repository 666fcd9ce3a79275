"""Sizes and switches of the networks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

LIFTS = ("none", "elastic")
VOLUMES = ("tissues", "whole")


@dataclass(frozen=True)
class NetworkSettings:
    """The section `network` of the configuration, which fixes the architecture; stored with every trained model.

    Layers of the interface encoders and of the two branches of the volume networks (boundary signal and rest
    geometry); channels and heads of the graph attention; nearest source nodes that an interface node pools;
    width of the decoders.

    decomposition: off gives the unified network, one graph network over the whole tissue fed the reference cue alone;
    match_parameters: widened until it has as many parameters as the networks of the decomposition.
    volume: without a lift, one volume network for each tissue, the mean of both where they meet, or one over the whole
    mesh.
    lift: what the free nodes of the sparse boundary signal carry: "none" is zero, as in the paper; "elastic"
    a linear extension of the interface (:mod:`pinnochio.mechanics.lift`) that the networks correct. With a
    lift, no volume layers mean no volume network.
    REMOVED: switches that trained networks in files still name, with the only value that is left of each.
    """

    REMOVED: ClassVar[Mapping[str, object]] = {
        "boundary": "soft",
        "blend": False,
        "segment_nodes": False,
        "edge_features": True,
        "long_edges": 0,
        "stiffness": False,
    }

    boundary_layers: int
    volume_layers: int
    rest_layers: int
    channels: int
    heads: int
    neighbours: int
    decoder_width: int
    decomposition: bool
    lift: str
    # As networks were that know nothing of it.
    match_parameters: bool = False
    volume: str = "tissues"

    def __post_init__(self):
        if self.channels % self.heads:
            raise ValueError(f"channels {self.channels} are not a multiple of heads {self.heads}")
        if self.lift not in LIFTS:
            raise ValueError(f"lift {self.lift!r} is not one of {LIFTS}")
        if self.volume not in VOLUMES:
            raise ValueError(f"volume {self.volume!r} is not one of {VOLUMES}")
        if self.lift != "none" and not self.decomposition:
            raise ValueError("the unified network has no interface to lift: lift 'none' goes with no decomposition")
        if self.lift == "none" and not self.volume_layers:
            raise ValueError("without volume layers nothing carries the interface inwards: choose a lift")
