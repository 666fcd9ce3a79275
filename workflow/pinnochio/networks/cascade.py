"""PINNOCHIO: the cascade bone -> muscle -> superficial tissue, and the unified network that it is compared with.

Each body has its own volume network and each interface kind its own boundary network:

    bone --P_bnd--> bone contact of muscle and of superficial tissue
    bone contact --P_vol--> muscle --P_bnd--> muscle-superficial interface
    bone contact, muscle-superficial interface --P_vol--> superficial tissue

Nodes of cut planes are given, at rest. A node that muscle and superficial tissue share takes the mean of the
two volume networks, so the mesh stays conforming and both networks see its loss.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pinnochio.networks.boundary import BoundaryNetwork
from pinnochio.networks.graph import Graph
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.volume import VolumeNetwork


@dataclass(frozen=True)
class Interface:
    """Interface nodes (i,) of the whole mesh, and their nearest nodes (i, k) of the source body."""

    nodes: Tensor
    neighbours: Tensor


@dataclass(frozen=True)
class Anatomy:
    """What the networks need of a patient, whatever the plan.

    Node indices refer to the whole mesh of n nodes. muscle_nodes and superficial_nodes list the nodes of the
    two graphs; bone_moved (b, 1) is 1 on movable segments; given (n, 1) is 1 on nodes held by a cut plane.
    """

    bone: Graph
    bone_moved: Tensor
    muscle: Graph
    muscle_nodes: Tensor
    superficial: Graph
    superficial_nodes: Tensor
    whole: Graph
    bone_muscle: Interface
    bone_superficial: Interface
    muscle_superficial: Interface
    given: Tensor


@dataclass(frozen=True)
class PlanSignal:
    """A plan: bone (b, 3) mm displacement of the bone surface, cue (n, 3) mm, reliable (n, 1)."""

    bone: Tensor
    cue: Tensor
    reliable: Tensor


@dataclass(frozen=True)
class Prediction:
    """displacement (n, 3) mm; boundary (n, 3) mm, the interface displacement, zero where known (n, 1) is 0."""

    displacement: Tensor
    boundary: Tensor
    known: Tensor


class Pinnochio(nn.Module):
    """The two-step cascade."""

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.bone_muscle = BoundaryNetwork(settings)
        self.bone_superficial = BoundaryNetwork(settings)
        self.muscle_superficial = BoundaryNetwork(settings)
        self.muscle = VolumeNetwork(settings)
        self.superficial = VolumeNetwork(settings)

    def forward(self, anatomy: Anatomy, plan: PlanSignal, mirror: bool = False) -> Prediction:
        """Displacement of every node; `mirror` solves the left-right mirrored patient and mirrors the answer back."""
        flip = plan.cue.new_tensor([-1.0 if mirror else 1.0, 1.0, 1.0])
        cue = plan.cue * flip
        boundary, known = torch.zeros_like(cue), anatomy.given
        total, count = torch.zeros_like(cue), torch.zeros_like(known)

        def interface(network, link, source, motion, moved):
            """Boundary signal and its mask with the nodes of `link` filled in."""
            if not len(link.nodes):
                return boundary, known
            at = link.nodes
            u = network(source, motion, moved, link.neighbours, cue[at], plan.reliable[at])
            return boundary.index_copy(0, at, u), known.index_fill(0, at, 1.0)

        bone = anatomy.bone.mirrored(flip), plan.bone * flip, anatomy.bone_moved
        boundary, known = interface(self.bone_muscle, anatomy.bone_muscle, *bone)
        boundary, known = interface(self.bone_superficial, anatomy.bone_superficial, *bone)
        if len(anatomy.muscle_nodes):
            graph, at = anatomy.muscle.mirrored(flip), anatomy.muscle_nodes
            u = self.muscle(graph, boundary[at], known[at])
            total, count = total.index_add(0, at, u), count.index_fill(0, at, 1.0)
            source = graph, u, torch.ones_like(u[:, :1])
            boundary, known = interface(self.muscle_superficial, anatomy.muscle_superficial, *source)
        at = anatomy.superficial_nodes
        u = self.superficial(anatomy.superficial.mirrored(flip), boundary[at], known[at])
        total, count = total.index_add(0, at, u), count.index_add(0, at, torch.ones_like(u[:, :1]))
        return Prediction(total / count.clamp_min(1.0) * flip, boundary * flip, known)


class Unified(nn.Module):
    """No decomposition: one volume network over the whole tissue, fed the reference cue where it is reliable."""

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.volume = VolumeNetwork(settings)

    def forward(self, anatomy: Anatomy, plan: PlanSignal, mirror: bool = False) -> Prediction:
        """As :meth:`Pinnochio.forward`; the boundary is the cue itself."""
        flip = plan.cue.new_tensor([-1.0 if mirror else 1.0, 1.0, 1.0])
        u = self.volume(anatomy.whole.mirrored(flip), plan.cue * flip, plan.reliable)
        return Prediction(u * flip, plan.cue, plan.reliable)


def build(settings: NetworkSettings) -> nn.Module:
    """The network of the settings, freshly initialised from torch's random state."""
    return Pinnochio(settings) if settings.decomposition else Unified(settings)
