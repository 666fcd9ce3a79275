"""A patient as the networks and losses read it: graphs, interfaces and the mechanics operator, as tensors."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pinnochio.anatomy.labels import MUSCLE
from pinnochio.anatomy.model import (
    BONE_MUSCLE,
    BONE_SUPERFICIAL,
    FIXED,
    FREE,
    MUSCLE_SUPERFICIAL,
    NO_INTERFACE,
    PatientModel,
)
from pinnochio.anatomy.plan import Plan
from pinnochio.mechanics.elements import VOLUMETRIC
from pinnochio.mechanics.materials import Material
from pinnochio.mechanics.residual import Operator
from pinnochio.networks.cascade import Anatomy, Interface, PlanSignal
from pinnochio.networks.graph import Graph

# Volume ratio below which the loss extends the energy: a raw network inverts elements, and a steeper extension would
# let these few outweigh all others. Above it the residual is the solver's own [I].
LOSS_EXTENSION = 0.1


@dataclass(frozen=True)
class PatientTensors:
    """What belongs to the patient and serves every plan.

    centre (3,) mm, the tissue's centroid, origin of all coordinates here; points (n, 3) mm float32; operator:
    internal force and energy, float32; free (f,) nodes without a boundary condition, the skin included.
    """

    model: PatientModel
    centre: np.ndarray
    points: Tensor
    anatomy: Anatomy
    operator: Operator
    free: Tensor

    @classmethod
    def build(
        cls,
        model: PatientModel,
        material: Material,
        volumetric: str = VOLUMETRIC[0],
        neighbours: int = 8,
        device: torch.device | str = "cpu",
    ) -> "PatientTensors":
        """Tensors of `model` on `device`; `neighbours` nearest source nodes are pooled per interface node."""
        corners = model.points[model.cells]
        volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
        centre = (corners.mean(1) * volume[:, None]).sum(0) / volume.sum()
        points = model.points - centre

        def tensor(values, dtype=torch.int64):
            return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype, device=device)

        def body(cells):
            """Nodes of the cells and their graph."""
            nodes, local = np.unique(cells, return_inverse=True)
            return nodes, Graph.build(points[nodes], local.reshape(cells.shape), device)

        def interface(kind, source):
            """Nodes of the interface with their nearest rows of the source points."""
            nodes = np.flatnonzero(model.interface_kind == kind)
            if not len(source):
                nodes = nodes[:0]
            near = np.zeros((0, 1), int)
            if len(nodes):
                near = cKDTree(source).query(points[nodes], np.arange(1, min(neighbours, len(source)) + 1))[1]
            return Interface(tensor(nodes), tensor(near))

        muscle_nodes, muscle = body(model.cells[model.tissue == MUSCLE])
        superficial_nodes, superficial = body(model.cells[model.tissue != MUSCLE])
        bone_points = model.bone_points - centre
        given = (model.node_type == FIXED) & (model.interface_kind == NO_INTERFACE)
        anatomy = Anatomy(
            bone=Graph.build(bone_points, model.bone_faces, device),
            bone_moved=tensor(model.bone_segment >= 0, torch.float32)[:, None],
            muscle=muscle,
            muscle_nodes=tensor(muscle_nodes),
            superficial=superficial,
            superficial_nodes=tensor(superficial_nodes),
            whole=Graph.build(points, model.cells, device),
            bone_muscle=interface(BONE_MUSCLE, bone_points),
            bone_superficial=interface(BONE_SUPERFICIAL, bone_points),
            muscle_superficial=interface(MUSCLE_SUPERFICIAL, points[muscle_nodes]),
            given=tensor(given, torch.float32)[:, None],
        )
        law = replace(material, extension=LOSS_EXTENSION)
        operator = Operator.build(points, model.cells, law, volumetric, torch.float32, device)
        free = tensor(np.flatnonzero(model.node_type == FREE))
        return cls(model, centre, tensor(points, torch.float32), anatomy, operator, free)

    @property
    def force_scale(self) -> float:
        """mN by which the physics loss divides: mean shear modulus times mean edge length squared."""
        return self.operator.mu_ref * self.operator.h_ref**2

    def signal(self, plan: Plan) -> PlanSignal:
        """The plan as the networks read it."""
        cue, reliable = self.model.reference_cue(plan)

        def tensor(values):
            return torch.as_tensor(values, dtype=torch.float32, device=self.points.device)

        return PlanSignal(tensor(self.model.bone_displacement(plan)), tensor(cue), tensor(reliable)[:, None])
