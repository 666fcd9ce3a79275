"""PINNOCHIO: the cascade bone -> muscle -> superficial tissue, and the unified network that it is compared with.

Each body has its own volume network and each interface kind its own boundary network:

    bone --P_bnd--> bone contact of muscle and of superficial tissue
    bone contact --P_vol--> muscle --P_bnd--> muscle-superficial interface
    bone contact, muscle-superficial interface --P_vol--> superficial tissue

Nodes of cut planes are given, at rest. A node that muscle and superficial tissue share takes the mean of the
two volume networks, so the mesh stays conforming and both networks see its loss. With a lift the bone contact is
extended through both tissues at once by a linear map of the patient's; the volume networks then correct that field.
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
class LiftTensors:
    """Linear extension of the interface: contact (i,) nodes, smoothing (q, i), departures (3 q, 3 n) per millimetre."""

    contact: Tensor
    smoothing: Tensor
    departures: Tensor


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
    lift: LiftTensors | None = None


@dataclass(frozen=True)
class PlanSignal:
    """A plan: bone (b, 3) mm displacement of the bone surface, cue (n, 3) mm, reliable (n, 1).

    lifted (n, 3) mm: the plan carried through the tissue by the lift; none without one.
    """

    bone: Tensor
    cue: Tensor
    reliable: Tensor
    lifted: Tensor | None = None


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
        self.register_buffer("flips", _flips(), persistent=False)
        self.lifted, self.hard = settings.lift != "none", settings.boundary == "hard"
        self.bone_muscle = BoundaryNetwork(settings)
        self.bone_superficial = BoundaryNetwork(settings)
        if not self.lifted:  # else the lift carries the signal from muscle to superficial tissue
            self.muscle_superficial = BoundaryNetwork(settings)
        if settings.volume_layers:
            self.muscle = VolumeNetwork(settings)
            self.superficial = VolumeNetwork(settings)

    def encode_rest(self, anatomy: Anatomy, mirror: bool = False) -> dict[str, Tensor]:
        """What the volume networks know of the patient's rest geometry; serves every plan."""
        flip = self.flips[int(mirror)]
        bodies = {"muscle": anatomy.muscle, "superficial": anatomy.superficial}
        if not hasattr(self, "superficial"):
            return {}
        return {name: getattr(self, name).encode_rest(body.mirrored(flip)) for name, body in bodies.items()}

    def forward(
        self, anatomy: Anatomy, plan: PlanSignal, mirror: bool = False, rest: dict[str, Tensor] | None = None
    ) -> Prediction:
        """Displacement of every node; `mirror` solves the left-right mirrored patient and mirrors the answer back.

        rest: of :meth:`encode_rest` for an unmirrored patient, if it is at hand.
        """
        flip = self.flips[int(mirror)]
        rest = self.encode_rest(anatomy, mirror) if rest is None else rest
        cue = plan.cue * flip
        boundary, known = torch.zeros_like(cue), anatomy.given

        def interface(network, link, source, motion, moved):
            """Boundary signal and its mask with the nodes of `link` filled in."""
            if not len(link.nodes):
                return boundary, known
            at = link.nodes
            u = network(source, motion, moved, link.neighbours, cue[at], plan.reliable[at])
            if self.hard:
                u = torch.where(plan.reliable[at] > 0, cue[at], u)
            return boundary.index_copy(0, at, u), known.index_fill(0, at, 1.0)

        bone = anatomy.bone.mirrored(flip), plan.bone * flip, anatomy.bone_moved
        boundary, known = interface(self.bone_muscle, anatomy.bone_muscle, *bone)
        boundary, known = interface(self.bone_superficial, anatomy.bone_superficial, *bone)
        if self.lifted:
            departure = ((boundary - cue) * flip)[anatomy.lift.contact]
            amplitudes = anatomy.lift.smoothing @ departure
            field = (plan.lifted + (amplitudes.flatten() @ anatomy.lift.departures).view_as(cue)) * flip
            carried = boundary = field
            if self.hard:
                boundary = torch.where(plan.reliable > 0, cue, boundary)
            boundary = boundary * known
        else:
            field, carried = torch.zeros_like(cue), boundary
        added, count = torch.zeros_like(cue), torch.zeros_like(known)

        def volume(network, name, graph, at):
            """Corrections of one tissue, summed up with their number per node."""
            u = network(graph.mirrored(flip), rest[name], carried[at], known[at])
            return u, added.index_add(0, at, u), count.index_add(0, at, torch.ones_like(u[:, :1]))

        if hasattr(self, "superficial"):
            if len(anatomy.muscle_nodes):
                u, added, count = volume(self.muscle, "muscle", anatomy.muscle, anatomy.muscle_nodes)
                if not self.lifted:
                    source = anatomy.muscle.mirrored(flip), u, torch.ones_like(u[:, :1])
                    boundary, known = interface(self.muscle_superficial, anatomy.muscle_superficial, *source)
                    carried = boundary
            _, added, count = volume(self.superficial, "superficial", anatomy.superficial, anatomy.superficial_nodes)
        displacement = field + added / count.clamp_min(1.0)
        if self.hard:
            displacement = torch.where(known > 0, boundary, displacement)
        return Prediction(displacement * flip, boundary * flip, known)


class Unified(nn.Module):
    """No decomposition: one volume network over the whole tissue, fed the reference cue where it is reliable."""

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.register_buffer("flips", _flips(), persistent=False)
        self.volume = VolumeNetwork(settings)

    def encode_rest(self, anatomy: Anatomy, mirror: bool = False) -> dict[str, Tensor]:
        """As :meth:`Pinnochio.encode_rest`."""
        return {"whole": self.volume.encode_rest(anatomy.whole.mirrored(self.flips[int(mirror)]))}

    def forward(
        self, anatomy: Anatomy, plan: PlanSignal, mirror: bool = False, rest: dict[str, Tensor] | None = None
    ) -> Prediction:
        """As :meth:`Pinnochio.forward`; the boundary is the cue itself."""
        flip = self.flips[int(mirror)]
        rest = self.encode_rest(anatomy, mirror) if rest is None else rest
        u = self.volume(anatomy.whole.mirrored(flip), rest["whole"], plan.cue * flip, plan.reliable)
        return Prediction(u * flip, plan.cue, plan.reliable)


def _flips() -> Tensor:
    """Signs (2, 3) of the coordinates of a patient and of its left-right mirror image."""
    return torch.tensor([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])


def build(settings: NetworkSettings) -> nn.Module:
    """The network of the settings, freshly initialised from torch's random state."""
    return Pinnochio(settings) if settings.decomposition else Unified(settings)
