"""P_bnd: displacement of the nodes on an interface, from the body that moves them."""

import torch
from torch import Tensor, nn
from torch.utils.weak import WeakTensorKeyDictionary

from pinnochio.networks.gatv2 import Decoder, Encoder
from pinnochio.networks.graph import DISPLACEMENT, LENGTH, Graph
from pinnochio.networks.settings import NetworkSettings

_KNOWN = WeakTensorKeyDictionary()  # what is read of a source, by the neighbours and the layers


class BoundaryNetwork(nn.Module):
    """Graph attention on the source body, max-pool over the nearest sources, decoder to interface displacement.

    The decoder gives the departure from the reference cue: u_bnd = c_ref + network, so an untrained network
    returns the cue (the rigid motion where the plan fixes it, zero elsewhere).
    """

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.encoder = Encoder(7, settings.channels, settings.heads, settings.boundary_layers)
        self.decoder = Decoder(settings.channels + 4, settings.decoder_width)

    def forward(
        self, source: Graph, motion: Tensor, moved: Tensor, neighbours: Tensor, cue: Tensor, reliable: Tensor
    ) -> Tensor:
        """Interface displacement (i, 3) mm.

        motion (s, 3) mm and moved (s, 1) flag of the source nodes; neighbours (i, k) source indices; cue (i,
        3) mm and reliable (i, 1), 1 where the plan fixes the motion.
        """
        nodes, chosen, edges, near = _read(source.edges, neighbours, len(self.encoder.layers), len(source.points))
        features = torch.cat([source.points / LENGTH, motion / DISPLACEMENT, moved], 1)[nodes]
        pooled = max_pool(self.encoder(features, edges, source.attributes[chosen]), near)
        return cue + DISPLACEMENT * self.decoder(torch.cat([pooled, cue / DISPLACEMENT, reliable], 1))


def max_pool(features: Tensor, neighbours: Tensor) -> Tensor:
    """Largest feature (i, f) over the neighbours (i, k) of each row, from features (s, f)."""
    gathered = features.index_select(0, neighbours.flatten())
    return gathered.view(*neighbours.shape, -1).amax(1)


def _read(edges: Tensor, neighbours: Tensor, layers: int, count: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """What so many layers read of a graph of `count` nodes to know the neighbours (i, k), kept as long as these live.

    Nodes (m,) and edges by their numbers in the graph, the same edges (2, e) and the neighbours (i, k) among the nodes.
    """
    known = _KNOWN.setdefault(neighbours, {})
    if layers not in known:
        read = torch.zeros(count, dtype=torch.bool, device=edges.device).index_fill_(0, neighbours.flatten(), True)
        for _ in range(layers):
            read = read.index_fill(0, edges[0, read[edges[1]]], True)
        nodes, chosen = read.nonzero()[:, 0], read[edges].all(0).nonzero()[:, 0]
        number = read.cumsum(0) - 1
        known[layers] = nodes, chosen, number[edges[:, chosen]], number[neighbours]
    return known[layers]
