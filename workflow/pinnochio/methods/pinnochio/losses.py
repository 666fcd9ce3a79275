"""The loss terms, each nondimensional or in mm^2 as its docstring says."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pinnochio.mechanics.elements.residual import Operator
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.networks.signals import InterfaceAndVolume

CHAMFER_SOFTENING = 1e-6  # mm^2 under the root, so that the gradient stays finite at zero distance
SPACING = 1.5  # mm between the points that stand for a surface
LEAF = 32  # points in a leaf of the k-d trees
PAIRS = 2**26  # distances that a GPU holds at a time


def volume_loss(displacement: Tensor, target: Tensor) -> Tensor:
    """Mean squared displacement error over all nodes, mm^2."""
    return (displacement - target).square().sum(1).mean()


def physics_loss(operator: Operator, free: Tensor, displacement: Tensor) -> Tensor:
    """Mean over V_free, nodes (f,), of |f_int|^2 / (mu h^2)^2: zero in equilibrium, nondimensional.

    The paper's term is the mean of |f_int|^2, whose size depends on units and mesh; mu is the mean shear
    modulus and h the mean edge length of the patient's mesh.
    """
    force = operator.force(displacement) / operator.force_scale
    return force.index_select(0, free).square().sum(1).mean()


def boundary_loss(prediction: InterfaceAndVolume, target: Tensor, anchored: Tensor) -> Tensor:
    """Boundary mismatch, mm^2.

    Our reading of the paper's term: mean |u - u_bnd|^2 over every node that a boundary network or a cut plane
    gives, plus mean |u_bnd - target|^2 over the `anchored` (n, 1) ones. The anchor is the reference cue on
    reliable nodes, and in pretraining the finite-element sample on all of them. The mismatch pulls u to u_bnd and not
    u_bnd to u, or the anchored interface would follow a raw volume network away from what is known.
    """
    mismatch = (prediction.displacement - prediction.boundary.detach()).square().sum(1, keepdim=True)
    departure = (prediction.boundary - target).square().sum(1, keepdim=True)
    known, anchored = prediction.known, anchored * prediction.known
    return (mismatch * known).sum() / known.sum().clamp_min(1) + (
        (departure * anchored).sum() / anchored.sum().clamp_min(1)
    )


@dataclass(frozen=True)
class FaceSamples:
    """Points on a triangle mesh, about SPACING apart: the centroids of equal parts of each triangle.

    faces (f, 3) node indices; weights (s, 3) barycentric coordinates; cumulative (f,) share of the area up to
    each face; border (f s,) bool, true on triangles that touch an open border.
    """

    faces: np.ndarray
    weights: np.ndarray
    cumulative: np.ndarray
    border: np.ndarray

    @classmethod
    def build(cls, points: np.ndarray, faces: np.ndarray) -> "FaceSamples":
        """Samples of the triangles `faces` over `points` (n, 3) mm; ValueError if there are none."""
        if not len(faces):
            raise ValueError("the surface holds no triangle")
        faces = np.asarray(faces, np.int64)
        corners = np.asarray(points, float)[faces]
        sides = np.roll(corners, -1, axis=1) - corners
        area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        weights = subdivision(int(np.clip(np.ceil(np.linalg.norm(sides, axis=2).mean() / SPACING), 1, 8)))
        border = np.repeat(border_nodes(faces, len(points))[faces].any(1), len(weights))
        return cls(faces, weights, np.cumsum(area) / area.sum(), border)

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Indices (count,) of samples, in proportion to area, ascending: neighbours follow each other in a search."""
        face = np.searchsorted(self.cumulative, np.sort(rng.random(count))).clip(max=len(self.faces) - 1)
        return face * len(self.weights) + rng.integers(len(self.weights), size=count)


class SurfaceLoss:
    """Symmetric Chamfer distance from a patient's predicted face to its post-operative skin, per millimetre.

    Half the sum of the two mean distances, unsquared: sqrt(d^2 + 1e-6 mm^2), as in the metric. Both surfaces
    are dense sets of points; `samples` of each, drawn in proportion to area, look for their exact nearest
    neighbour among all points of the other. Pairs that end on the other surface's open border, or further
    apart than `cutoff` mm, are dropped, because the scan covers another part of the head than the face region
    does.
    """

    def __init__(
        self, patient: PatientTensors, points: np.ndarray, faces: np.ndarray, samples: int = 4096, cutoff: float = 15.0
    ):
        """Target mesh: points (k, 3) mm and faces (l, 3) of the registered post-operative skin."""
        model, real = patient.model, patient.points

        def tensor(values):
            return torch.as_tensor(values, device=real.device)

        self.face = FaceSamples.build(model.skin_points, model.skin_faces[model.face_roi])
        self.other = FaceSamples.build(points, faces)
        self.rest = tensor(model.skin_points - patient.centre).to(real.dtype)
        self.carriers = tensor(model.skin_nodes).long()
        self.carry = tensor(model.skin_weights).to(real.dtype)
        self.faces, self.weights = tensor(self.face.faces), tensor(self.face.weights).to(real.dtype)
        self.face_border, self.other_border = tensor(self.face.border), tensor(self.other.border)
        corners = (np.asarray(points, float) - patient.centre)[self.other.faces]
        self.target = tensor(np.einsum("sc,fcx->fsx", self.other.weights, corners).reshape(-1, 3)).to(real.dtype)
        self.tree = None if real.is_cuda else cKDTree(self.target.numpy(), leafsize=LEAF)
        self.samples, self.cutoff = samples, cutoff

    def __call__(self, displacement: Tensor, rng: np.random.Generator) -> Tensor:
        """Chamfer distance of the displaced face; `rng` draws the samples of both surfaces."""
        return self.between(displacement, *self.draw(rng))

    def draw(self, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Samples of the face and of the post-operative skin, indices (samples,)."""
        face, other = self.face.draw(rng, self.samples), self.other.draw(rng, self.samples)
        return torch.as_tensor(face, device=self.rest.device), torch.as_tensor(other, device=self.rest.device)

    def between(self, displacement: Tensor, face: Tensor, other: Tensor) -> Tensor:
        """Chamfer distance of the displaced face by these samples.

        ValueError on a CPU if no pair counts; on a GPU, where nothing waits for the outcome, it is then no number.
        """
        skin = self.rest + torch.einsum("sc,scx->sx", self.carry, displacement[self.carriers])
        points = torch.einsum("sc,fcx->fsx", self.weights, skin[self.faces]).flatten(0, 1)
        here = points.detach()
        if self._on_gpu():
            distance, reached = all_pairs(here[face], self.target)
            forward = self._weighted(points, face, reached, (distance < self.cutoff) & ~self.other_border[reached])
            distance, reached = all_pairs(self.target[other], here)
            back = self._weighted(points, reached, other, (distance < self.cutoff) & ~self.face_border[reached])
            return 0.5 * (forward + back)
        if not torch.isfinite(here).all():
            return points.sum() * float("nan")
        near, reached = nearest(here[face], self.target, self.cutoff, self.tree)
        forward = self._mean(points, face[near], reached, self.other_border[reached])
        near, reached = nearest(self.target[other], here, self.cutoff)
        back = self._mean(points, reached, other[near], self.face_border[reached])
        return 0.5 * (forward + back)

    def _on_gpu(self) -> bool:
        return self.rest.is_cuda

    def _mean(self, points, face, other, border):
        """Mean distance between points[own] and target[other] over the pairs that do not end on a border."""
        face, other = face[~border], other[~border]
        if not len(face):
            raise ValueError(f"no face point within {self.cutoff} mm of the post-operative skin: is it registered?")
        return self._apart(points, face, other).mean()

    def _weighted(self, points, face, other, counts):
        """The same over the pairs that count, in tensors whose shapes belong to the patient."""
        return (self._apart(points, face, other) * counts).sum() / counts.sum()

    def _apart(self, points, face, other):
        apart = points.index_select(0, face) - self.target[other]
        return apart.square().sum(1).add(CHAMFER_SOFTENING).sqrt()


def nearest(queries: Tensor, cloud: Tensor, cutoff: float, tree: cKDTree | None = None) -> tuple[Tensor, Tensor]:
    """Queries (k,), by index, with a point of the cloud nearer than `cutoff`, and the index (k,) of their nearest one.

    queries (q, 3), cloud (c, 3), mm, on the CPU. Exact up to the rounding of distances, by the k-d tree of the cloud,
    made here if there is none yet.
    """
    # Neither balanced nor compact, the tree takes a third of the time to build; it serves one step.
    tree = tree or cKDTree(cloud.numpy(), leafsize=LEAF, balanced_tree=False, compact_nodes=False)
    distance, index = map(torch.as_tensor, tree.query(queries.numpy(), distance_upper_bound=cutoff))
    near = torch.nonzero(distance < cutoff)[:, 0]
    return near, index[near]


def all_pairs(queries: Tensor, cloud: Tensor) -> tuple[Tensor, Tensor]:
    """Distance (q,) mm and index (q,) of the nearest point of the cloud (c, 3) to each query (q, 3).

    By looking at all pairs, which is faster on a GPU than any tree: a matrix product in float64, whose cancellation
    leaves 1e-9 mm2 at the size of a head.
    """
    points, squares = cloud.double().T, cloud.double().square().sum(1)
    parts = queries.split(PAIRS // len(cloud) + 1)
    index = torch.cat([torch.addmm(squares, part.double(), points, alpha=-2).argmin(1) for part in parts])
    return (queries - cloud[index]).norm(dim=1), index


def border_nodes(faces: np.ndarray, count: int) -> np.ndarray:
    """(count,) bool, true on nodes of an edge that only one triangle has."""
    edges = np.sort(np.asarray(faces)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    border = np.zeros(count, bool)
    border[unique[uses == 1]] = True
    return border


def subdivision(split: int) -> np.ndarray:
    """Barycentric coordinates (split^2, 3) of the centroids of the equal parts of a triangle."""
    up = [(i, j) for i in range(split) for j in range(split - i)]
    down = [(i, j) for i in range(split - 1) for j in range(split - 1 - i)]
    centres = [(i + 1 / 3, j + 1 / 3) for i, j in up] + [(i + 2 / 3, j + 2 / 3) for i, j in down]
    first = np.array(centres) / split
    return np.column_stack([first, 1 - first.sum(1)])
