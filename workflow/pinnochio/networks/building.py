"""The graph network that settings ask for."""

from dataclasses import replace
from functools import cache

import torch
from torch import nn

from pinnochio.networks.cascade import Cascade, OneVolume
from pinnochio.networks.lifted import Lifted
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.unified import Unified

LANES = 16  # float32 numbers in a register: attention takes three times as long where a head's channels are no multiple


def build(settings: NetworkSettings) -> nn.Module:
    """The network of the settings, freshly initialised from torch's random state."""
    if not settings.decomposition:
        return Unified(matched(settings) if settings.match_parameters else settings)
    if settings.lift != "none":
        return Lifted(settings)
    return Cascade(settings) if settings.volume == "tissues" else OneVolume(settings)


@cache
def matched(settings: NetworkSettings) -> NetworkSettings:
    """Settings of a unified network with about as many parameters as the decomposed one of the same settings.

    First the channels, LANES of each head at a time, are as many as leave it smaller; then the width of the decoder
    comes as near as it can.
    """
    wanted = parameters(replace(settings, decomposition=True, match_parameters=False))
    unified = replace(settings, match_parameters=False)
    unified = _widened(unified, "channels", LANES * settings.heads, wanted)
    below = _widened(unified, "decoder_width", 2, wanted)
    above = replace(below, decoder_width=below.decoder_width + 2)
    return min(below, above, key=lambda each: abs(parameters(each) - wanted))


def _widened(settings: NetworkSettings, name: str, step: int, most: int) -> NetworkSettings:
    """With as many further steps of one setting as leave at most so many parameters, by bisection."""

    def wider(steps: int) -> NetworkSettings:
        return replace(settings, **{name: getattr(settings, name) + steps * step})

    low, high = 0, 1
    while parameters(wider(high)) <= most:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if parameters(wider(middle)) <= most else (low, middle)
    return wider(low)


def parameters(settings: NetworkSettings) -> int:
    """Trained numbers of the network of the settings."""
    with torch.device("meta"):
        return sum(weight.numel() for weight in build(settings).parameters())
