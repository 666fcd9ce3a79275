"""P_vol: displacement of every node of one tissue, from what is known on its boundary."""

import torch
from torch import Tensor, nn

from pinnochio.networks.attention import Decoder, Encoder
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

    def forward(self, graph: Graph, sparse: Tensor, mask: Tensor, lift: Tensor | None = None) -> Tensor:
        """Displacement (n, 3) mm.

        sparse (n, 3) mm boundary displacement, zero on free nodes; mask (n, 1), 1 where it is given; lift (n,
        3) mm displacement that the network corrects, none for zero.
        """
        rest = self.rest(graph.points / LENGTH, graph.edges, graph.attributes)
        carried = sparse if lift is None else lift
        given = torch.cat([carried / DISPLACEMENT, mask], 1)
        signal = self.signal(given, graph.edges, graph.attributes)
        correction = DISPLACEMENT * self.decoder(torch.cat([rest, signal, given], 1))
        return correction if lift is None else lift + correction
