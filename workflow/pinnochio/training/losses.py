"""The loss terms, each nondimensional or in mm^2 as its docstring says."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pinnochio.networks.cascade import Prediction
from pinnochio.training.patient import PatientTensors

CHAMFER_SOFTENING = 1e-6  # mm^2 under the root, so that the gradient stays finite at zero distance
SPACING = 1.5  # mm between the points that stand for a surface


def volume_loss(displacement: Tensor, target: Tensor) -> Tensor:
    """Mean squared displacement error over all nodes, mm^2."""
    return (displacement - target).square().sum(1).mean()


def physics_loss(patient: PatientTensors, displacement: Tensor) -> Tensor:
    """Mean over V_free of |f_int|^2 / (mu h^2)^2: zero in equilibrium, nondimensional.

    The paper's term is the mean of |f_int|^2, whose size depends on units and mesh; mu is the mean shear
    modulus and h the mean edge length of the patient's mesh.
    """
    force = patient.operator.force(displacement) / patient.force_scale
    return force.index_select(0, patient.free).square().sum(1).mean()


def boundary_loss(prediction: Prediction, target: Tensor, anchored: Tensor) -> Tensor:
    """Boundary mismatch, mm^2.

    Our reading of the paper's term: mean |u - u_bnd|^2 over every node that a boundary network or a cut plane
    gives, plus mean |u_bnd - target|^2 over the `anchored` (n, 1) ones. The anchor is the reference cue on
    reliable nodes, and in pretraining the teacher on all of them. The mismatch pulls u to u_bnd and not u_bnd
    to u, or the anchored interface would follow a raw volume network away from what is known.
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
        """Indices (count,) of samples, in proportion to area."""
        face = np.searchsorted(self.cumulative, rng.random(count)).clip(max=len(self.faces) - 1)
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
        self,
        patient: PatientTensors,
        points: np.ndarray,
        faces: np.ndarray,
        samples: int = 4096,
        cutoff: float = 15.0,
    ):
        """Target mesh: points (k, 3) mm and faces (l, 3) of the registered post-operative skin."""
        model = patient.model
        self.own = FaceSamples.build(model.skin_points, model.skin_faces[model.face_roi])
        self.other = FaceSamples.build(points, faces)
        self.rest = torch.as_tensor(model.skin_points - patient.centre, dtype=patient.points.dtype).to(patient.points)
        self.carriers = torch.as_tensor(model.skin_nodes, dtype=torch.long, device=self.rest.device)
        self.carry = torch.as_tensor(model.skin_weights, dtype=self.rest.dtype, device=self.rest.device)
        self.faces = torch.as_tensor(self.own.faces, device=self.rest.device)
        self.weights = torch.as_tensor(self.own.weights, dtype=self.rest.dtype, device=self.rest.device)
        corners = (np.asarray(points, float) - patient.centre)[self.other.faces]
        self.target = np.einsum("sc,fcx->fsx", self.other.weights, corners).reshape(-1, 3)
        self.tree = cKDTree(self.target)
        self.samples, self.cutoff = samples, cutoff

    def __call__(self, displacement: Tensor, rng: np.random.Generator) -> Tensor:
        """Chamfer distance of the displaced face; `rng` draws the samples of both surfaces."""
        skin = self.rest + torch.einsum("sc,scx->sx", self.carry, displacement[self.carriers])
        points = torch.einsum("sc,fcx->fsx", self.weights, skin[self.faces]).flatten(0, 1)
        here = points.detach().cpu().numpy()
        if not np.isfinite(here).all():
            return points.sum() * float("nan")
        own, other = self.own.draw(rng, self.samples), self.other.draw(rng, self.samples)
        distance, nearest = self.tree.query(here[own])
        forward = self._mean(points, own, nearest, (distance < self.cutoff) & ~self.other.border[nearest])
        distance, nearest = cKDTree(here).query(self.target[other])
        back = self._mean(points, nearest, other, (distance < self.cutoff) & ~self.own.border[nearest])
        return 0.5 * (forward + back)

    def _mean(self, points, own, other, keep):
        """Mean distance between points[own] and target[other] over the pairs to keep."""
        if not keep.any():
            raise ValueError(f"no face point within {self.cutoff} mm of the post-operative skin: is it registered?")
        index = torch.as_tensor(own[keep], device=points.device)
        goal = torch.as_tensor(self.target[other[keep]], dtype=points.dtype, device=points.device)
        return (points.index_select(0, index) - goal).square().sum(1).add(CHAMFER_SOFTENING).sqrt().mean()


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
