"""Meshes as graphs: directed edges of triangles or tetrahedra, sorted by target."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

# Fixed scales that bring the networks' inputs and outputs to order one.
LENGTH = 50.0  # mm, positions
EDGE = 5.0  # mm, edge vectors
DISPLACEMENT = 5.0  # mm, displacements


@dataclass(frozen=True)
class Graph:
    """Nodes of one body with attention edges, self-loops included.

    points (n, 3) rest positions about the patient's centre, mm; edges (2, e) int64 rows source and target,
    sorted by target, then source; attributes (e, 4) source minus target and its length, divided by EDGE.
    """

    points: Tensor
    edges: Tensor
    attributes: Tensor

    @classmethod
    def build(cls, points: np.ndarray, elements: np.ndarray, device: torch.device | str = "cpu") -> "Graph":
        """Graph of the (m, 3) triangles or (m, 4) tetrahedra over `points` (n, 3) mm."""
        n = len(points)
        corners = np.triu_indices(elements.shape[1], 1)
        pairs = np.asarray(elements)[:, np.stack(corners, 1)].reshape(-1, 2)
        ends = np.concatenate([pairs, pairs[:, ::-1], np.arange(n)[:, None].repeat(2, 1)]).T
        near = sparse.csr_array((np.ones(len(ends[0]), bool), ends), (n, n))  # sorts in a quarter of np.unique's time
        near.sum_duplicates()
        target, source = np.arange(n).repeat(np.diff(near.indptr)), near.indices.astype(np.int64)
        vector = points[source] - points[target]
        attributes = np.column_stack([vector, np.linalg.norm(vector, axis=1)]) / EDGE
        real = {"dtype": torch.float32, "device": device}
        return cls(
            torch.as_tensor(points, **real),
            torch.as_tensor(np.stack([source, target]), device=device),
            torch.as_tensor(attributes, **real),
        )

    def mirrored(self, flip: Tensor) -> "Graph":
        """The graph with coordinates multiplied by `flip` (3,) of +-1."""
        attributes = self.attributes * torch.cat([flip, flip.new_ones(1)])
        return Graph(self.points * flip, self.edges, attributes)
