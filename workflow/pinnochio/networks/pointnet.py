"""PointNet++ for a value per point (Qi et al. 2017), its layers from torch_geometric."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch_geometric.nn import MLP, PointNetConv

from pinnochio.geometry.scattered import spread
from pinnochio.networks.clouds import PointCloud


def perceptron(*widths: int) -> MLP:
    """Shared layers of these widths, each with batch normalisation and ReLU: the 1x1 convolutions of the papers."""
    return MLP(list(widths), norm="batch_norm", plain_last=False)


class PointNet2(nn.Module):
    """Set abstraction, then feature propagation: features (n, width) of a cloud's points, or one code of the whole.

    inputs: features of each point; down: widths of each level's layers; whole: of the layers under the maximum over
    all points, if there are any; up: of the layers that bring features back to the finer points, the coarsest first.
    None of these, and the answer is the code.
    """

    def __init__(
        self, down: Sequence[Sequence[int]], up: Sequence[Sequence[int]], whole: Sequence[int] = (), inputs: int = 3
    ):
        super().__init__()
        widths = [inputs, *(layers[-1] for layers in down)]
        self.down = nn.ModuleList(
            PointNetConv(perceptron(width + 3, *layers), add_self_loops=False)
            for width, layers in zip(widths[:-1], down, strict=True)
        )
        self.whole = perceptron(widths[-1] + 3, *whole) if whole else None
        coarse = [whole[-1] if whole else widths.pop(), *(layers[-1] for layers in up)]
        self.up = nn.ModuleList(
            perceptron(below + skip, *layers) for below, skip, layers in zip(coarse, widths[::-1], up, strict=False)
        )

    def forward(self, cloud: PointCloud, count: int, features: Tensor | None = None) -> Tensor:
        """Features of every point of `count` clouds of one size, joined, or the codes (count, width)."""
        levels = [(cloud.points if features is None else features, cloud.points)]
        for layer, level in zip(self.down, cloud.levels, strict=True):
            values, places = levels[-1]
            levels.append((layer((values, None), (places, level.points), level.edges), level.points))
        ways = [(level.near, level.weights) for level in cloud.levels]
        values, places = levels.pop()
        if self.whole is not None:
            every = self.whole(torch.cat([values, places], 1))
            code = every.view(count, -1, every.shape[1]).amax(1)
            if not self.up:
                return code
            levels.append((values, places))
            each = torch.arange(count, device=values.device).repeat_interleave(len(values) // count)
            ways.append((each[:, None], torch.ones_like(values[:, :1])))
            values = code
        for layer in self.up:
            values = layer(torch.cat([spread(values, *ways.pop()), levels.pop()[0]], 1))
        return values
