"""Loss terms of the surface networks, in the networks' units; points and targets of one patient."""

import torch
from torch import Tensor
from torch_geometric.utils import scatter

DENSITY_NEIGHBOURS = 8


def chamfer(points: Tensor, target: Tensor, seen: Tensor, squared: bool = False) -> Tensor:
    """Mean distance from points (n, 3) to their nearest target and from targets (t, 3) to their nearest point, added.

    seen (n,): weight of the points in their mean. squared: of the distances.
    """
    with torch.no_grad():
        apart = torch.cdist(points, target)
        ahead, back = apart.argmin(1), apart.argmin(0)
    there = (_length(points - target[ahead], squared) * seen).sum() / seen.sum()
    return there + _length(target - points[back], squared).mean()


def density(points: Tensor, target: Tensor, squared: bool = False) -> Tensor:
    """Mean difference between how far the nearest points and how far the nearest other targets are from a target."""
    count = min(DENSITY_NEIGHBOURS, len(points), len(target))
    with torch.no_grad():
        near = torch.cdist(target, points).topk(count, largest=False).indices
        within = torch.cdist(target, target).topk(count, largest=False).values
    apart = _length(points[near] - target[:, None], squared)
    return (apart - (within.square() if squared else within)).abs().mean()


def local_change(rest: Tensor, moved: Tensor, pairs: Tensor) -> Tensor:
    """Mean change of the distance between the points of each pair (p, 2); zero without any."""
    if not len(pairs):
        return moved.sum() * 0
    before, after = (_length(points[pairs[:, 0]] - points[pairs[:, 1]]) for points in (rest, moved))
    return (after - before).abs().mean()


def laplacian_change(displacement: Tensor, edges: Tensor) -> Tensor:
    """Mean square of the change of each point's place among its neighbours along the edges (2, e)."""
    around = scatter(displacement[edges[0]], edges[1], 0, len(displacement), "mean")
    return (displacement - around).square().sum(1).mean()


def _length(offset: Tensor, squared: bool = False) -> Tensor:
    square = offset.square().sum(-1)
    return square if squared else (square + 1e-12).sqrt()
