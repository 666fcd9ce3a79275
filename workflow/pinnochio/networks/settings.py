"""Sizes and switches of the networks."""

from dataclasses import dataclass

LIFTS = ("none", "harmonic", "elastic")
BOUNDARIES = ("soft", "hard")


@dataclass(frozen=True)
class NetworkSettings:
    """The section `network` of the configuration, which fixes the architecture; stored with every trained model.

    Layers of the interface encoders and of the two branches of the volume networks (boundary signal and rest
    geometry); channels and heads of the graph attention; nearest source nodes that an interface node pools;
    width of the decoders.

    decomposition: off gives the unified network, one graph network over the whole tissue fed the reference cue alone;
    match_parameters: widened until it has as many parameters as the networks of the decomposition.
    lift: what the free nodes of the sparse boundary signal carry: "none" is zero, as in the paper; "harmonic" and
    "elastic" a linear extension of the interface (:mod:`pinnochio.mechanics.lift`) that the networks correct. With a
    lift, no volume layers mean no volume network.
    boundary: "soft" leaves the boundary to the loss (the paper); "hard" keeps nodes whose motion the plan fixes there
    and gives the interface's displacement to its nodes. blend: the cue of sliding nodes is the inverse-distance blend
    of the segments' motions, not zero. segment_nodes: one virtual node per bone in the bone graph, joined to all of its
    nodes [S: MIXPINN]. edge_features: attention sees edge vector and length. long_edges: hub nodes that every tissue
    node is joined to. stiffness: the tissue's stiffness is an input of the volume networks.
    """

    boundary_layers: int
    volume_layers: int
    rest_layers: int
    channels: int
    heads: int
    neighbours: int
    decoder_width: int
    decomposition: bool
    lift: str
    boundary: str
    blend: bool
    segment_nodes: bool
    edge_features: bool
    long_edges: int
    stiffness: bool
    match_parameters: bool = False  # as networks were that know nothing of it

    def __post_init__(self):
        if self.channels % self.heads:
            raise ValueError(f"channels {self.channels} are not a multiple of heads {self.heads}")
        if self.lift not in LIFTS:
            raise ValueError(f"lift {self.lift!r} is not one of {LIFTS}")
        if self.boundary not in BOUNDARIES:
            raise ValueError(f"boundary {self.boundary!r} is not one of {BOUNDARIES}")
        if self.lift != "none" and not self.decomposition:
            raise ValueError("the unified network has no interface to lift: lift 'none' goes with no decomposition")
        if self.lift == "none" and not self.volume_layers:
            raise ValueError("without volume layers nothing carries the interface inwards: choose a lift")
