"""Graph attention (GATv2) and the encoder that stacks it."""

import math
from functools import cache

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from pinnochio.networks import gatv2_cpu
from pinnochio.networks.layout import Inputs, Layout

try:
    from pinnochio.networks import gatv2_gpu
except ImportError:  # triton is absent
    gatv2_gpu = None


SLOPE = 0.2  # of the leaky ReLU, torch_geometric's


class Attention(nn.Module):
    """Residual layer x + GELU(GATv2(x)), with the parameters of torch_geometric's GATv2Conv.

    In float32 compiled loops over the edges of each node take the place of torch_geometric's edge-sized tensors: those
    of numba on a CPU, of Triton on a GPU, where it is installed. Same result up to rounding, deterministic.
    """

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.width, self.heads = width, heads
        self.lin_l, self.lin_r = nn.Linear(width, width), nn.Linear(width, width)
        self.lin_edge = nn.Linear(4, width, bias=False)
        self.att = nn.Parameter(torch.empty(1, heads, width // heads))
        self.bias = nn.Parameter(torch.zeros(width))
        for linear in (self.lin_l, self.lin_r, self.lin_edge):
            _glorot(linear.weight)
            if linear.bias is not None:
                nn.init.uniform_(linear.bias, -1 / math.sqrt(width), 1 / math.sqrt(width))
        _glorot(self.att)

    def forward(self, x: Tensor, edges: Tensor, attributes: Tensor) -> Tensor:
        """Nodes (n, width) to (n, width); edges (2, e) sorted by target, self-loops included; attributes (e, 4)."""
        loops = {"cpu": gatv2_cpu, "cuda": gatv2_gpu}.get(x.device.type)
        if loops is None or x.dtype != torch.float32 or not len(x):
            return self.general(x, edges, attributes)
        return _Compiled.apply(
            loops,
            Layout.of(edges, len(x)),
            SLOPE,
            x,
            attributes,
            self.lin_l.weight,
            self.lin_l.bias,
            self.lin_r.weight,
            self.lin_r.bias,
            self.lin_edge.weight,
            self.att,
            self.bias,
        )

    def general(self, x: Tensor, edges: Tensor, attributes: Tensor) -> Tensor:
        """The same by torch_geometric's kernels."""
        kernels, weights = _kernels(self.width, self.heads), dict(self.named_parameters())
        return x + nn.functional.gelu(torch.func.functional_call(kernels, weights, (x, edges, attributes)))


@cache
def _kernels(width: int, heads: int) -> nn.Module:
    """torch_geometric's layer without weights; loaded where it is needed, for it takes seconds."""
    from torch_geometric.nn import GATv2Conv

    with torch.device("meta"):
        return GATv2Conv(width, width // heads, heads, edge_dim=4, add_self_loops=False)


def _glorot(weight: Tensor) -> None:
    bound = math.sqrt(6 / (weight.size(-2) + weight.size(-1)))
    nn.init.uniform_(weight, -bound, bound)


class _Compiled(torch.autograd.Function):
    """The layer around the loops of `gatv2_cpu` or `gatv2_gpu`; the attributes get no gradient."""

    @staticmethod
    def forward(ctx, loops, layout, slope, x, attributes, left, left_shift, right, right_shift, w, a, bias):
        x, weight = x.contiguous(), torch.cat([left, right])
        # The weights of a node's sources sum to one, so the shift of the sources is one of the result.
        inputs = Inputs(
            st=x @ weight.T,
            shift=left_shift + right_shift,
            w=w.T.contiguous(),
            a=a[0].contiguous(),
            bias=bias + left_shift,
            d=attributes.contiguous(),
        )
        out, *kept = loops.forward(x, inputs, layout, slope)
        ctx.save_for_backward(x, weight, *inputs, *kept)
        ctx.loops, ctx.layout, ctx.slope = loops, layout, slope
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient):
        x, weight, *saved = ctx.saved_tensors
        count = len(Inputs._fields)
        inputs, kept = Inputs(*saved[:count]), saved[count:]
        gradient = gradient.contiguous()
        gst, gshift, gw, ga, gbias = ctx.loops.backward(gradient, inputs, kept, ctx.layout, ctx.slope)
        gx = torch.addmm(gradient, gst, weight)
        gleft, gright = (gst.T @ x).chunk(2)
        return None, None, None, gx, None, gleft, gshift + gbias, gright, gshift, gw.T, ga[None], gbias


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
            h = layer(h, edges, attributes)
        return h


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers of these widths with GELU between them."""
    layers = [nn.Linear(widths[0], widths[1])]
    for a, b in zip(widths[1:], widths[2:], strict=False):
        layers += [nn.GELU(), nn.Linear(a, b)]
    return nn.Sequential(*layers)


class Decoder(nn.Module):
    """Features (n, inputs) -> 3 components: an MLP on the normalised features plus a linear path past it.

    The linear path lets an input displacement pass through at full size from the first steps on. Both
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
