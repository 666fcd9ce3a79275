"""Graph attention (GATv2) and the encoder that stacks it."""

import torch
from torch import Tensor, nn
from torch_geometric.nn import GATv2Conv

try:
    from pinnochio.networks import attention_cpu
except ImportError:  # numba is absent: torch_geometric's own kernels serve the processor too
    attention_cpu = None


class Attention(GATv2Conv):
    """torch_geometric's GATv2 layer; on a CPU in float32 it runs one fused loop instead of edge-sized tensors.

    Edges must be sorted by target and hold the self-loops. Same parameters, same result up to rounding.
    """

    def __init__(self, width: int, heads: int):
        super().__init__(width, width // heads, heads, edge_dim=4, add_self_loops=False)

    def forward(self, x: Tensor, edges: Tensor, attributes: Tensor) -> Tensor:
        if attention_cpu is None or x.is_cuda or x.dtype != torch.float32:
            return super().forward(x, edges, attributes)
        return self.bias + attention_cpu.attend(
            self.lin_l(x), self.lin_r(x), self.lin_edge.weight, self.att[0], edges, attributes, self.negative_slope
        )


class Encoder(nn.Module):
    """Node features (n, inputs) -> (n, width): an MLP per node, then `depth` residual attention layers.

    The layers are not normalised: with layer normalisation the same training left a tenth more error [X],
    since the size of a displacement is what the features carry.
    """

    def __init__(self, inputs: int, width: int, heads: int, depth: int):
        super().__init__()
        self.lift = mlp(inputs, width, width)
        self.layers = nn.ModuleList(Attention(width, heads) for _ in range(depth))

    def forward(self, features: Tensor, edges: Tensor, attributes: Tensor) -> Tensor:
        h = self.lift(features)
        for layer in self.layers:
            h = h + nn.functional.gelu(layer(h, edges, attributes))
        return h


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers of these widths with GELU between them."""
    layers = [nn.Linear(widths[0], widths[1])]
    for a, b in zip(widths[1:], widths[2:], strict=False):
        layers += [nn.GELU(), nn.Linear(a, b)]
    return nn.Sequential(*layers)


class Decoder(nn.Module):
    """Features (n, inputs) -> 3 components: an MLP on the normalised features plus a linear path past it.

    The linear path lets displacement that is given pass through at full size from the first steps on. Both
    parts end at zero, so training starts from no correction.
    """

    def __init__(self, inputs: int, width: int):
        super().__init__()
        self.curved = nn.Sequential(nn.LayerNorm(inputs), *mlp(inputs, width, width // 2, 3))
        self.linear = nn.Linear(inputs, 3)
        for last in (self.curved[-1], self.linear):
            nn.init.zeros_(last.weight)
            nn.init.zeros_(last.bias)

    def forward(self, features: Tensor) -> Tensor:
        return self.curved(features) + self.linear(features)
