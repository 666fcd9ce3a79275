"""The unified network that is compared on equal terms: as many parameters as the decomposed ones."""

from dataclasses import asdict

import pytest
import torch

from pinnochio.methods.pinnochio.learner import GraphLearner
from pinnochio.networks.building import build, matched, parameters
from tests.helpers.settings import CONFIG, network_settings

PAPER = {"boundary_layers": 4, "volume_layers": 12, "rest_layers": 12, "channels": 128}


@pytest.mark.parametrize("volume", ["whole", "tissues"])
@pytest.mark.parametrize("sizes", [{}, PAPER, {"channels": 32, "heads": 2}], ids=["study", "paper", "small"])
def test_a_unified_network_gets_the_parameters_of_the_decomposed_ones(sizes, volume):
    sizes = sizes | {"volume": volume}
    wanted, plain = parameters(network_settings(**sizes)), network_settings(decomposition=False, **sizes)
    wide = matched(plain)
    assert abs(parameters(wide) - wanted) < 0.002 * wanted
    assert wide.channels > plain.channels if volume == "tissues" else wide.decoder_width > plain.decoder_width
    assert (wide.volume_layers, wide.rest_layers, wide.heads) == (plain.volume_layers, plain.rest_layers, plain.heads)
    assert parameters(wide) == sum(weight.numel() for weight in build(plain).parameters())


def test_the_sizes_of_the_study_s_networks():
    assert parameters(network_settings()) == 241_192
    assert parameters(network_settings(volume="tissues")) == 337_154
    assert parameters(network_settings(decomposition=False, match_parameters=False)) == 95_962


def test_counting_leaves_the_random_state_alone():
    torch.manual_seed(0)
    first = torch.rand(3)
    torch.manual_seed(0)
    matched.cache_clear()
    matched(network_settings(decomposition=False))
    assert torch.equal(torch.rand(3), first)


def test_a_learner_stores_the_settings_that_it_trains():
    """A prediction builds the network without counting again; a decomposed one is as it was."""
    settings = {name: CONFIG[name] for name in ("fem", "pretraining")}
    unified = network_settings(decomposition=False)
    network = GraphLearner(settings | {"network": asdict(unified)}, "pretrain", "cpu").network
    assert network == matched(unified) and not network.match_parameters
    assert GraphLearner(settings | {"network": CONFIG["network"]}, "pretrain", "cpu").network == network_settings()
