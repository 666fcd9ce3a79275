"""P_bnd: displacement of the nodes on an interface, from the body that moves them."""

import torch
from torch import Tensor, nn

from pinnochio.networks.gatv2 import Decoder, Encoder
from pinnochio.networks.graph import DISPLACEMENT, LENGTH, Graph
from pinnochio.networks.settings import NetworkSettings


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
        features = torch.cat([source.points / LENGTH, motion / DISPLACEMENT, moved], 1)
        encoded = self.encoder(features, source.edges, source.attributes)
        pooled = max_pool(encoded, neighbours)
        return cue + DISPLACEMENT * self.decoder(torch.cat([pooled, cue / DISPLACEMENT, reliable], 1))


def max_pool(features: Tensor, neighbours: Tensor) -> Tensor:
    """Largest feature (i, f) over the neighbours (i, k) of each row, from features (s, f)."""
    gathered = features.index_select(0, neighbours.flatten())
    return gathered.view(*neighbours.shape, -1).amax(1)
