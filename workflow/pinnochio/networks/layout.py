"""What the compiled attention layer reads: its inputs, and where the edges of each node lie, once per graph."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary


class Inputs(NamedTuple):
    """What both directions of the compiled layer read, float32 and contiguous.

    st (n, 2 h c): s and t of the nodes; shift (h c,) of s + t; w (4, h c) edge weight; a (h, c) attention vector; bias
    (h c,); d (e, 4) edge attributes.
    """

    st: Tensor
    shift: Tensor
    w: Tensor
    a: Tensor
    bias: Tensor
    d: Tensor


_KNOWN = WeakTensorKeyDictionary()


@dataclass(frozen=True)
class Layout:
    """Edges (2, e), rows source and target, sorted by target; int32 indices.

    source, target (e,); arriving (n + 1,): the edges into node i are arriving[i] to arriving[i + 1].
    """

    source: Tensor
    target: Tensor
    arriving: Tensor

    @classmethod
    def of(cls, edges: Tensor, nodes: int) -> "Layout":
        """The layout of `edges` over this number of nodes, kept as long as the tensor lives.

        ValueError unless every node has an edge into it, as a graph with self-loops does, sorted by target.
        """
        known = _KNOWN.get(edges)
        if known is None or len(known.arriving) != nodes + 1:
            source, target = edges
            every = torch.arange(nodes, device=edges.device)
            complete = torch.equal(target.unique_consecutive(), every)  # hence sorted, and none beyond the nodes
            if not complete or (nodes and not 0 <= int(source.min()) <= int(source.max()) < nodes):
                raise ValueError(
                    "the edges are not sorted by target, miss a self-loop, or name a node that is not there"
                )
            known = _KNOWN[edges] = cls(source.int(), target.int(), _starts(target, nodes))
        return known

    @cached_property
    def leaving(self) -> tuple[Tensor, Tensor]:
        """Edges sorted by source (e,), and where those out of each node begin (n + 1,)."""
        source, order = self.source.sort(stable=True)
        return order.int(), _starts(source, len(self.arriving) - 1)


def _starts(ordered: Tensor, nodes: int) -> Tensor:
    """Where each node begins in its sorted numbers (e,), and where the last one ends: (nodes + 1,)."""
    every = torch.arange(nodes + 1, device=ordered.device, dtype=ordered.dtype)
    return torch.searchsorted(ordered.contiguous(), every).int()
