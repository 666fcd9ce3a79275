"""A patient as the networks and losses read it: graphs, interfaces and the mechanics operator, as tensors."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.residual import Operator
from pinnochio.mechanics.lift import Lift, motion_amplitudes, node_shares
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.labels import MUSCLE
from pinnochio.model.patient import (
    BONE_MUSCLE,
    BONE_SUPERFICIAL,
    FIXED,
    FREE,
    MOVING,
    MUSCLE_SUPERFICIAL,
    NO_INTERFACE,
    PatientModel,
)
from pinnochio.networks.graph import Graph
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import Interface, LiftTensors, PlanSignal, TissueGraphs
from pinnochio.plans.plan import Plan

# Volume ratio below which the loss extends the energy: a raw network inverts elements, and a steeper extension would
# let these few outweigh all others. Above it the residual is the solver's own [I].
LOSS_EXTENSION = 0.1


@dataclass(frozen=True)
class PatientTensors:
    """What belongs to the patient and serves every plan.

    centre (3,) mm, the tissue's centroid, origin of all coordinates here; points (n, 3) mm float32; operator:
    internal force and energy, float32; free (f,) nodes without a boundary condition, the skin included; settings of the
    networks that will read it; motions (12 K, 3 n) of the lift, if there is one. bone_followers, followers: what moves
    the bone and the interface nodes; reliable (n, 1), 1 where the plan fixes the motion.
    """

    model: PatientModel
    centre: np.ndarray
    points: Tensor
    anatomy: TissueGraphs
    operator: Operator
    free: Tensor
    settings: NetworkSettings
    bone_followers: "Followers"
    followers: "Followers"
    reliable: Tensor
    lift: Lift | None = None
    motions: Tensor | None = None

    @classmethod
    def build(
        cls,
        model: PatientModel,
        material: Material,
        volumetric: str,
        settings: NetworkSettings,
        lift: Lift | None = None,
        device: torch.device | str = "cpu",
    ) -> "PatientTensors":
        """Tensors of `model` on `device`, as networks of `settings` read them; ValueError if they miss a lift."""
        if (lift is None) != (settings.lift == "none"):
            raise ValueError(f"the network's lift is {settings.lift!r}, the patient's is {'there' if lift else 'not'}")
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
                count = np.arange(1, min(settings.neighbours, len(source)) + 1)
                near = cKDTree(source).query(points[nodes], count)[1]
            return Interface(tensor(nodes), tensor(near))

        muscle_nodes, muscle = body(model.cells[model.tissue == MUSCLE])
        superficial_nodes, superficial = body(model.cells[model.tissue != MUSCLE])
        bone_points = model.bone_points - centre
        cut = (model.node_type == FIXED) & (model.interface_kind == NO_INTERFACE)
        anatomy = TissueGraphs(
            bone=Graph.build(bone_points, model.bone_faces, device),
            bone_moved=tensor(model.bone_segment >= 0, torch.float32)[:, None],
            muscle=muscle,
            muscle_nodes=tensor(muscle_nodes),
            superficial=superficial,
            superficial_nodes=tensor(superficial_nodes),
            whole=body(model.cells)[1],
            bone_muscle=interface(BONE_MUSCLE, bone_points),
            bone_superficial=interface(BONE_SUPERFICIAL, bone_points),
            muscle_superficial=interface(MUSCLE_SUPERFICIAL, points[muscle_nodes]),
            cut=tensor(cut, torch.float32)[:, None],
            lift=lift
            and LiftTensors(
                tensor(lift.contact),
                tensor(lift.smoothing, torch.float32),
                tensor(lift.departures.reshape(len(lift.departures), -1), torch.float32),
            ),
        )
        law = replace(material, extension=LOSS_EXTENSION)
        operator = Operator.build(points, model.cells, law, volumetric, torch.float32, device)
        free = tensor(np.flatnonzero(model.node_type == FREE))
        motions = None if lift is None else tensor(lift.motions.reshape(len(lift.motions), -1), torch.float32)
        return cls(
            model,
            centre,
            tensor(points, torch.float32),
            anatomy,
            operator,
            free,
            settings,
            Followers.build(bone_points, np.arange(len(model.segments)) == model.bone_segment[:, None], device),
            Followers.build(points, node_shares(model, (MOVING,)), device),
            tensor(np.isin(model.node_type, (FIXED, MOVING)), torch.float32)[:, None],
            lift,
            motions,
        )

    def signal(self, plan: Plan) -> PlanSignal:
        """The plan as the networks read it."""

        def amplitudes(centre):
            values = motion_amplitudes(plan, self.model.segments, centre)
            return torch.as_tensor(values, dtype=self.points.dtype, device=self.points.device)

        motions = amplitudes(self.centre)
        bone, cue, lifted = self.bone_followers.displacement(motions), self.followers.displacement(motions), None
        if self.lift is not None:
            lifted = (amplitudes(self.lift.centre) @ self.motions).view_as(self.points)
            contact = self.anatomy.lift.contact  # what the lift says of the sliding nodes is their cue
            cue[contact] = lifted[contact]
        return PlanSignal(bone, cue, self.reliable, lifted)


@dataclass(frozen=True)
class Followers:
    """Points (p,) that follow segments: arms (p, 4), coordinates about the patient's centre and a one; share (p, K)."""

    arms: Tensor
    share: Tensor

    @classmethod
    def build(cls, points: np.ndarray, share: np.ndarray, device: torch.device | str) -> "Followers":
        """Of points (p, 3) mm about the centre and the share of each segment in their motion."""
        real = {"dtype": torch.float32, "device": device}
        arms = np.column_stack([points, np.ones(len(points))])
        return cls(torch.as_tensor(arms, **real), torch.as_tensor(np.ascontiguousarray(share), **real))

    def displacement(self, amplitudes: Tensor) -> Tensor:
        """Displacement (p, 3) mm under motions of these amplitudes (12 K,) about the centre."""
        motions = amplitudes.view(-1, 12)
        maps = torch.cat([motions[:, :9].view(-1, 3, 3), motions[:, 9:, None]], 2)  # (K, 3, 4)
        moved = (self.arms @ maps.flatten(0, 1).T).view(len(self.arms), -1, 3)
        return (moved * self.share[:, :, None]).sum(1)


def tensors(
    model: PatientModel, fem: FemSettings, network: NetworkSettings, device: str, lift: Lift | None = None
) -> PatientTensors:
    """The model as tensors, with the material of `fem`."""
    return PatientTensors.build(model, fem.material(model.tissue), fem.volumetric, network, lift, device)
