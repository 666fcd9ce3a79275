"""Optimiser of the graph networks: orthogonal steps for weight matrices, AdamW for all else.

Muon after Jordan et al. 2024 (kellerjordan.github.io/posts/muon), sized as AdamW's steps (Liu et al. 2025,
arXiv 2502.16982). `torch.optim.Muon` goes through bfloat16, which most processors only imitate: a step of it costs as
much as the loss and its gradient [X].
"""

from collections import defaultdict
from collections.abc import Callable, Iterable

import torch
from torch import Tensor, nn

MOMENTUM = 0.95
QUINTIC = (3.4445, -4.7750, 2.0315)  # brings singular values from 0.001..1 to 0.7..1.2 in five rounds [S]
ROUNDS = 5
SMALLEST = 8  # rows or columns of a matrix; narrower ones, such as of three coordinates, are AdamW's


class Muon(torch.optim.AdamW):
    """AdamW in whose stead matrices take steps with equal singular values; `times` its learning rate, 0 for none."""

    def __init__(self, parameters: Iterable[nn.Parameter], times: float, **adamw):
        groups = defaultdict(list)
        for parameter in parameters:
            matrix = times and parameter.ndim == 2 and min(parameter.shape) >= SMALLEST
            groups[tuple(parameter.shape) if matrix else ()].append(parameter)
        means = {shape: [torch.zeros_like(matrix) for matrix in groups[shape] if shape] for shape in groups}
        super().__init__([{"params": groups[shape], "means": means[shape]} for shape in groups], **adamw)
        self._times = times

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:
        """One step of every parameter by its gradient."""
        groups = self.param_groups
        for group in groups:
            self._orthogonal(group)
        self.param_groups = [group for group in groups if not group["means"]]
        super().step(closure)
        self.param_groups = groups

    def _orthogonal(self, group: dict) -> None:
        """Move those of the group's matrices, all of one shape, that have a gradient; AdamW's groups have no means."""
        moved = [pair for pair in zip(group["params"], group["means"], strict=False) if pair[0].grad is not None]
        if not moved:
            return
        for matrix, mean in moved:
            mean.lerp_(matrix.grad, 1 - MOMENTUM)
        ahead = torch.stack([matrix.grad.lerp(mean, MOMENTUM) for matrix, mean in moved])
        rate = self._times * group["lr"]
        size = 0.2 * max(ahead.shape[1:]) ** 0.5  # root mean square of AdamW's steps [S]
        for (matrix, _), direction in zip(moved, orthogonalised(ahead), strict=True):
            matrix.mul_(1 - rate * group["weight_decay"]).sub_(direction, alpha=rate * size)


def orthogonalised(matrices: Tensor) -> Tensor:
    """Matrices (k, n, m) with the same singular vectors and singular values near one."""
    tall = matrices.shape[1] > matrices.shape[2]
    x = matrices.mT if tall else matrices
    x = x / (x.norm(dim=(1, 2), keepdim=True) + 1e-7)
    a, b, c = QUINTIC
    for _ in range(ROUNDS):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x.mT if tall else x
