"""What PINNOCHIO is compared with: one volume network over the whole tissue, without decomposition."""

from torch import Tensor, nn

from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import InterfaceAndVolume, PlanSignal, TissueGraphs, mirror_signs
from pinnochio.networks.volume_network import VolumeNetwork


class Unified(nn.Module):
    """The network is fed the reference cue where it is reliable."""

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.register_buffer("flips", mirror_signs(), persistent=False)
        self.volume = VolumeNetwork(settings)

    def encode_rest(self, anatomy: TissueGraphs, mirror: bool = False) -> dict[str, Tensor]:
        """What the network knows of the patient's rest geometry; serves every plan."""
        return {"whole": self.volume.encode_rest(anatomy.whole.mirrored(self.flips[int(mirror)]))}

    def forward(
        self, anatomy: TissueGraphs, plan: PlanSignal, mirror: bool = False, rest: dict[str, Tensor] | None = None
    ) -> InterfaceAndVolume:
        """As :meth:`~pinnochio.networks.cascade.Cascade.forward`; the boundary is the cue itself."""
        flip = self.flips[int(mirror)]
        rest = self.encode_rest(anatomy, mirror) if rest is None else rest
        u = self.volume(anatomy.whole.mirrored(flip), rest["whole"], plan.cue * flip, plan.reliable)
        return InterfaceAndVolume(u * flip, plan.cue, plan.reliable)
