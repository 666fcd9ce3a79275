"""The network with a lift: a linear map of the patient's carries the bone contact through both tissues at once.

    bone --P_bnd--> bone contact --lift--> field of both tissues
    field --P_vol--> muscle, superficial tissue

The volume networks correct that field; with none of them it is the answer.
"""

from torch import Tensor

from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import InterfaceAndVolume, PlanSignal, TissueGraphs
from pinnochio.networks.tissues import Added, TwoTissues
from pinnochio.networks.volume_network import VolumeNetwork


class Lifted(TwoTissues):
    """Boundary networks, the lift and, with volume layers, two corrections."""

    def __init__(self, settings: NetworkSettings):
        super().__init__(settings)
        self.muscle = VolumeNetwork(settings) if settings.volume_layers else None
        self.superficial = VolumeNetwork(settings) if settings.volume_layers else None

    def forward(
        self, anatomy: TissueGraphs, plan: PlanSignal, mirror: bool = False, rest: dict[str, Tensor] | None = None
    ) -> InterfaceAndVolume:
        """As :meth:`~pinnochio.networks.cascade.Cascade.forward`."""
        flip = self.flips[int(mirror)]
        rest = self.encode_rest(anatomy, mirror) if rest is None else rest
        cue, contact = plan.cue * flip, self.bone_contact(anatomy, plan, flip)
        known = contact.known
        departure = ((contact.displacement - cue) * flip)[anatomy.lift.contact]
        amplitudes = anatomy.lift.smoothing @ departure
        field = (plan.lifted + (amplitudes.flatten() @ anatomy.lift.departures).view_as(cue)) * flip
        added = Added.nothing(field)
        tissues = (
            (self.muscle, "muscle", anatomy.muscle, anatomy.muscle_nodes),
            (self.superficial, "superficial", anatomy.superficial, anatomy.superficial_nodes),
        )
        for network, name, graph, nodes in tissues:
            if network and len(nodes):
                added = added.plus(nodes, network(graph.mirrored(flip), rest[name], field[nodes], known[nodes]))
        return InterfaceAndVolume(added.onto(field) * flip, field * known * flip, known)
