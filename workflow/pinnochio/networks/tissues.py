"""What the networks of two tissues share: the bone's boundary networks, and the sum of what the volume networks add."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pinnochio.networks.boundary import BoundaryNetwork
from pinnochio.networks.graph import Graph
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import Interface, PlanSignal, TissueGraphs, mirror_signs
from pinnochio.networks.volume_network import VolumeNetwork


@dataclass(frozen=True)
class InterfaceSource:
    """A body that moves an interface: its graph, motion (s, 3) mm and flag moved (s, 1)."""

    graph: Graph
    motion: Tensor
    moved: Tensor


@dataclass(frozen=True)
class Boundary:
    """Displacement (n, 3) mm of the nodes where it is known (n, 1), zero elsewhere."""

    displacement: Tensor
    known: Tensor

    def filled(
        self, network: BoundaryNetwork, interface: Interface, source: InterfaceSource, cue: Tensor, reliable: Tensor
    ) -> "Boundary":
        """With the nodes of the interface as the network puts them."""
        nodes = interface.nodes
        if not len(nodes):
            return self
        u = network(source.graph, source.motion, source.moved, interface.neighbours, cue[nodes], reliable[nodes])
        return Boundary(self.displacement.index_copy(0, nodes, u), self.known.index_fill(0, nodes, 1.0))


@dataclass(frozen=True)
class Added:
    """What the volume networks add to a field: total (n, 3) mm, and the number (n, 1) of networks that speak of a node.

    A node that muscle and superficial tissue share takes the mean, so the mesh stays conforming and both networks see
    its loss.
    """

    total: Tensor
    count: Tensor

    @classmethod
    def nothing(cls, field: Tensor) -> "Added":
        """To a field (n, 3)."""
        return cls(torch.zeros_like(field), torch.zeros_like(field[:, :1]))

    def plus(self, nodes: Tensor, u: Tensor) -> "Added":
        """With u (k, 3) mm at the nodes (k,) of one tissue."""
        return Added(self.total.index_add(0, nodes, u), self.count.index_add(0, nodes, torch.ones_like(u[:, :1])))

    def onto(self, field: Tensor) -> Tensor:
        """The field (n, 3) mm with it."""
        return field + self.total / self.count.clamp_min(1.0)


class TwoTissues(nn.Module):
    """Muscle and superficial tissue: boundary networks from the bone, and a volume network each, which may be none."""

    muscle: VolumeNetwork | None
    superficial: VolumeNetwork | None

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.register_buffer("flips", mirror_signs(), persistent=False)
        self.bone_muscle = BoundaryNetwork(settings)
        self.bone_superficial = BoundaryNetwork(settings)

    def encode_rest(self, anatomy: TissueGraphs, mirror: bool = False) -> dict[str, Tensor]:
        """What the volume networks know of the patient's rest geometry; serves every plan."""
        flip = self.flips[int(mirror)]
        bodies = {"muscle": (self.muscle, anatomy.muscle), "superficial": (self.superficial, anatomy.superficial)}
        return {name: network.encode_rest(body.mirrored(flip)) for name, (network, body) in bodies.items() if network}

    def bone_contact(self, anatomy: TissueGraphs, plan: PlanSignal, flip: Tensor) -> Boundary:
        """Boundary of the nodes in contact with bone and of the cut planes; flip (3,) mirrors the patient, or not."""
        cue, boundary = plan.cue * flip, Boundary(torch.zeros_like(plan.cue), anatomy.cut)
        bone = InterfaceSource(anatomy.bone.mirrored(flip), plan.bone * flip, anatomy.bone_moved)
        boundary = boundary.filled(self.bone_muscle, anatomy.bone_muscle, bone, cue, plan.reliable)
        return boundary.filled(self.bone_superficial, anatomy.bone_superficial, bone, cue, plan.reliable)
