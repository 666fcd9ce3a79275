"""The graph network that settings ask for."""

from torch import nn

from pinnochio.networks.cascade import Cascade
from pinnochio.networks.lifted import Lifted
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.unified import Unified


def build(settings: NetworkSettings) -> nn.Module:
    """The network of the settings, freshly initialised from torch's random state."""
    if not settings.decomposition:
        return Unified(settings)
    return Cascade(settings) if settings.lift == "none" else Lifted(settings)
