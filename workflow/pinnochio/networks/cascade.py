"""PINNOCHIO as published, of which two readings are possible: each interface kind has its own boundary network.

To the letter one volume network follows over the whole mesh (OneVolume). Or each body has its own (Cascade):

    bone --P_bnd--> bone contact of muscle and of superficial tissue
    bone contact --P_vol--> muscle --P_bnd--> muscle-superficial interface
    bone contact, muscle-superficial interface --P_vol--> superficial tissue
"""

from dataclasses import replace

import torch
from torch import Tensor

from pinnochio.networks.boundary import BoundaryNetwork
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import InterfaceAndVolume, PlanSignal, TissueGraphs
from pinnochio.networks.tissues import Added, InterfaceSource, TwoTissues
from pinnochio.networks.unified import Unified
from pinnochio.networks.volume_network import VolumeNetwork


class Cascade(TwoTissues):
    """The cascade bone -> muscle -> superficial tissue."""

    def __init__(self, settings: NetworkSettings):
        super().__init__(settings)
        self.muscle_superficial = BoundaryNetwork(settings)
        self.muscle, self.superficial = VolumeNetwork(settings), VolumeNetwork(settings)

    def forward(
        self, anatomy: TissueGraphs, plan: PlanSignal, mirror: bool = False, rest: dict[str, Tensor] | None = None
    ) -> InterfaceAndVolume:
        """Displacement of every node; `mirror` solves the left-right mirrored patient and mirrors the answer back.

        rest: of :meth:`encode_rest` for an unmirrored patient, if it is at hand.
        """
        flip = self.flips[int(mirror)]
        rest = self.encode_rest(anatomy, mirror) if rest is None else rest
        boundary, field = self.bone_contact(anatomy, plan, flip), torch.zeros_like(plan.cue)
        added, nodes = Added.nothing(field), anatomy.muscle_nodes
        if len(nodes):
            muscle = anatomy.muscle.mirrored(flip)
            u = self.muscle(muscle, rest["muscle"], boundary.displacement[nodes], boundary.known[nodes])
            added, source = added.plus(nodes, u), InterfaceSource(muscle, u, torch.ones_like(u[:, :1]))
            boundary = boundary.filled(
                self.muscle_superficial, anatomy.muscle_superficial, source, plan.cue * flip, plan.reliable
            )
        nodes, graph = anatomy.superficial_nodes, anatomy.superficial.mirrored(flip)
        u = self.superficial(graph, rest["superficial"], boundary.displacement[nodes], boundary.known[nodes])
        displacement = added.plus(nodes, u).onto(field)
        return InterfaceAndVolume(displacement * flip, boundary.displacement * flip, boundary.known)


class OneVolume(TwoTissues):
    """The cascade's interfaces, and one volume network over the whole mesh: the paper's P_vol to the letter [I].

    That is the unified network with the interfaces for its cue. Without a motion of the muscle the interface of both
    tissues is read off what is known on the muscle's surface.
    """

    def __init__(self, settings: NetworkSettings):
        super().__init__(settings)
        self.muscle_superficial = BoundaryNetwork(settings)
        self.whole = Unified(settings)

    def encode_rest(self, anatomy: TissueGraphs, mirror: bool = False) -> dict[str, Tensor]:
        return self.whole.encode_rest(anatomy, mirror)

    def forward(
        self, anatomy: TissueGraphs, plan: PlanSignal, mirror: bool = False, rest: dict[str, Tensor] | None = None
    ) -> InterfaceAndVolume:
        """As :meth:`Cascade.forward`."""
        flip, nodes = self.flips[int(mirror)], anatomy.muscle_nodes
        boundary = self.bone_contact(anatomy, plan, flip)
        source = InterfaceSource(anatomy.muscle.mirrored(flip), boundary.displacement[nodes], boundary.known[nodes])
        boundary = boundary.filled(
            self.muscle_superficial, anatomy.muscle_superficial, source, plan.cue * flip, plan.reliable
        )
        known = replace(plan, cue=boundary.displacement * flip, reliable=boundary.known)
        return self.whole(anatomy, known, mirror, rest)
