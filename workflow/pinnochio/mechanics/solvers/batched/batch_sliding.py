"""The sliding nodes of many plans, put back on their bones and given their local axes.

As :class:`pinnochio.mechanics.boundary.sliding.SlidingNodes`, by whose kernels a CPU does it, plan by plan; on a GPU
those of `batch_sliding_gpu`. Axes of nodes (s,) under k plans are arrays (s, 3, 3, k), in rows.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from pinnochio.mechanics.boundary.sliding import Bones, SlidingNodes
from pinnochio.mechanics.solvers.batched.sparse_rows import fused


class TooManyPointsError(RuntimeError):
    """A bone has more points than a GPU's programs can hold."""


class BatchAxes:
    """Axes (s, 3, 3, k) of the sliding nodes under some plans."""

    def __init__(self, bones: Bones, plans: int, device):
        self.axes = torch.zeros(len(bones.nodes), 3, 3, plans, dtype=torch.float64, device=device)
        self._nodes = torch.as_tensor(bones.nodes, device=device)

    def turn(self, vectors: Tensor) -> Tensor:
        """Take those vectors, of all (n, 3, k), that belong to sliding nodes into their axes and their parts along the
        normals off them; these parts (s, k)."""
        local = inward(self.axes, vectors[self._nodes].double()).to(vectors.dtype)
        normal = local[:, 0].clone()
        local[:, 0] = 0
        vectors[self._nodes] = local
        return normal


class BatchSliding(BatchAxes):
    """Sliding nodes under some plans, on a CPU; axes: where :meth:`project` left them."""

    def __init__(self, bones: Bones, plans: int, device):
        super().__init__(bones, plans, device)
        self._held: list[SlidingNodes | None] = [None] * plans

    def begin(self, slots: Sequence[int], held: Sequence[SlidingNodes]) -> None:
        """Other plans, or parts of a load, in some slots."""
        for slot, item in zip(slots, held, strict=True):
            self._held[slot] = item

    def project(self, u: Tensor, wanted: Tensor) -> None:
        """Move the sliding nodes of displacements u (n, 3, k) mm along their normals back on their bones, of the plans
        (k,) bool that are wanted."""
        for slot, held in enumerate(self._held):
            if held is not None and wanted[slot]:
                field = u[:, :, slot].contiguous()
                self.axes[:, :, :, slot] = torch.as_tensor(held.project(field.numpy()))
                u[:, :, slot] = field


@fused
def inward(axes, vectors):
    """Vectors (s, 3, k) of the world in axes (s, 3, 3, k)."""
    return (axes * vectors[:, None]).sum(2)


@fused
def outward(axes, vectors):
    """Vectors (s, 3, k) in axes (s, 3, 3, k) back in those of the world."""
    return (axes * vectors[:, :, None]).sum(1)


@fused
def carried(axes, warp, rest):
    """The warp (s, 3, 3, k) from axes at rest (s, 3, 3, 1) to axes (s, 3, 3, k), zero along both normals."""
    axes, rest = axes.to(warp.dtype), rest.to(warp.dtype)
    turned = (axes[:, :, :, None] * warp[:, None]).sum(2)
    turned = (turned[:, :, None] * rest[:, None]).sum(3)
    turned[:, 0] = turned[:, :, 0] = 0
    return turned
