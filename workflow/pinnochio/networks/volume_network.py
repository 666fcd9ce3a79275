"""P_vol: displacement of every node of one tissue, from what is known on its boundary."""

import torch
from torch import Tensor, nn

from pinnochio.networks.gatv2 import Decoder, Encoder
from pinnochio.networks.graph import DISPLACEMENT, LENGTH, Graph
from pinnochio.networks.settings import NetworkSettings


class VolumeNetwork(nn.Module):
    """Two graph-attention branches, one on the rest geometry one on the sparse boundary signal; one decoder, which also
    sees the signal itself.

    An untrained network returns the lift: with lift "none" zero everywhere, so every J is 1.
    """

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.rest = Encoder(3, settings.channels, settings.heads, settings.rest_layers)
        self.signal = Encoder(4, settings.channels, settings.heads, settings.volume_layers)
        self.decoder = Decoder(2 * settings.channels + 4, settings.decoder_width)

    def encode_rest(self, graph: Graph) -> Tensor:
        """Features (n, channels) of the rest geometry, which belong to the patient and serve every plan."""
        return self.rest(graph.points / LENGTH, graph.edges, graph.attributes)

    def forward(self, graph: Graph, rest: Tensor, carried: Tensor, mask: Tensor) -> Tensor:
        """What the network adds to the lift, (n, 3) mm.

        rest: of :meth:`encode_rest`; carried (n, 3) mm boundary displacement, on free nodes the lift or zero; mask (n,
        1), 1 where the displacement is known.
        """
        sparse = torch.cat([carried / DISPLACEMENT, mask], 1)
        signal = self.signal(sparse, graph.edges, graph.attributes)
        return DISPLACEMENT * self.decoder(torch.cat([rest, signal, sparse], 1))
