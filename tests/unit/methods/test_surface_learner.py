"""The surface networks: published widths, joined patients, and that each can learn a patient by heart."""

import numpy as np
import pytest
import torch
from torch import nn
from torch_geometric.nn import EdgeConv

from pinnochio.methods.surface.architectures import build
from pinnochio.methods.surface.learner import supervised
from pinnochio.methods.surface.patient import SurfacePatient
from pinnochio.methods.surface.settings import ARCHITECTURES
from pinnochio.networks.clouds import SurfaceInputs, per_patient, scaled
from pinnochio.networks.dgcfp import EdgeConvolution
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import surface_settings

SMALL = {"points": 64, "neighbours": 8, "repeats": 1}


def conv(*widths):
    """Numbers of 1x1 convolutions of these widths, each with batch normalisation."""
    return sum(a * b + 3 * b for a, b in zip(widths, widths[1:], strict=False))


# The layers as the published codes list them [S]; a convolution without a norm has a * b + b.
POINT_ENCODER = (
    conv(3 + 3, 64, 64, 128) + conv(128 + 3, 128, 128, 256) + conv(256 + 3, 256, 256, 512)
    + conv(512 + 3, 512, 512, 1024)
    + conv(1024 + 512, 512, 512) + conv(512 + 256, 512, 256) + conv(256 + 128, 256, 128) + conv(128 + 3, 128, 128, 128)
)  # fmt: skip
ACMT = 2 * POINT_ENCODER + 2 * conv(128, 64) + conv(6, 64) + (64 * 3 + 3)
FSCNET = (
    POINT_ENCODER + 2 * (128 * 64 + 64) + (128 * 128 + 128)
    + conv(6 + 3, 64, 64, 128) + conv(128 + 3, 128, 128, 128) + conv(128 + 3, 128, 128, 128)
    + conv(256, 128, 64) + (64 * 3 + 3)
)  # fmt: skip
# Each level has two steps, each of two streams; the first sees differences of place and normal alone.
LEVEL = 2 * conv(2 * 128, 128, 64)
DGCFP = (
    2 * conv(6, 128, 64) + LEVEL + 4 * 2 * LEVEL + 4 * (2 * conv(2 * 256, 128, 64) + LEVEL)
    + conv(3 + 3, 64, 128) + conv(128 + 3, 128, 256) + conv(256 + 3, 256, 512) + conv(512 + 3, 512, 1024)
    + conv(1024 + 512, 512, 512) + conv(512 + 256, 256, 256) + conv(256 + 128, 128, 128) + conv(128 + 3, 128, 128)
    + 2 * conv(128, 64) + conv(6, 64) + conv(128, 64)
    + 2 * (conv(64, 128, 64) + 64 * 3 + 3) + conv(2 * 67, 128, 64)
)  # fmt: skip


def patient(architecture, seed=0, **options):
    return SurfacePatient.build(
        tiny_patient(seed, (13, 9, 4), 6.0), surface_settings(architecture, **SMALL, **options), f"P{seed}", 1
    )


def inputs(prepared, plan=None):
    return prepared.inputs(prepared.draws[0], plan or tiny_plan())


def random_weights(architecture, **options):
    torch.manual_seed(1)
    return build(surface_settings(architecture, **SMALL, **options))


@pytest.mark.parametrize(("architecture", "expected"), [("acmt", ACMT), ("fscnet", FSCNET), ("dgcfp", DGCFP)])
def test_layers_are_as_wide_as_published(architecture, expected):
    assert sum(value.numel() for value in random_weights(architecture).parameters()) == expected


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_joined_patients_are_each_as_alone(architecture):
    network = random_weights(architecture).eval()
    alone = [inputs(patient(architecture, seed)) for seed in range(2)]
    with torch.no_grad():
        torch.manual_seed(0)
        both = per_patient(network(SurfaceInputs.join(alone)), 2)
        for number, one in enumerate(alone):
            torch.manual_seed(0)
            first = network(one)[0]
            assert torch.allclose(both[number][0].rest, first.rest)
            assert torch.allclose(both[number][0].displacement, first.displacement, atol=1e-5)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_the_plan_matters_and_the_bone_alone_carries_it(architecture):
    """In training, where batch normalisation keeps the signal of random weights from fading; beside another plan,
    because it takes a code that all points share away."""
    network, prepared = random_weights(architecture), patient(architecture)
    fields = []
    with torch.no_grad():
        for plan in (tiny_plan(), tiny_plan(x=-4.0), tiny_plan()):
            torch.manual_seed(0)
            both = network(SurfaceInputs.join([inputs(prepared, plan), inputs(prepared, tiny_plan(z=2.0))]))
            fields.append(per_patient(both, 2)[0][-1].displacement)
    assert torch.equal(fields[0], fields[2]) and (fields[0] - fields[1]).abs().max() > 1e-4


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_each_learns_two_patients_by_heart(architecture):
    """A rigid shift that differs between two patients, from random weights, in a few steps."""
    network = random_weights(architecture)
    both = SurfaceInputs.join(
        [inputs(patient(architecture, 0)), inputs(patient(architecture, 1), tiny_plan(x=-3.0, y=2.0))]
    )
    shifts = [torch.tensor([0.05, 0.0, -0.02]), torch.tensor([-0.03, 0.04, 0.0])]
    optimizer = torch.optim.Adam(network.parameters(), 2e-3)
    losses = []
    for step in range(60):
        torch.manual_seed(step)
        parts = per_patient(network(both), 2)
        targets = [shift.expand_as(part[0].rest) for part, shift in zip(parts, shifts, strict=True)]
        loss = sum(supervised(part, target) for part, target in zip(parts, targets, strict=True))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert np.median(losses[-5:]) < 0.03 * max(losses[0], 0.003)


def test_attention_divides_by_the_bone_points():
    """With features all alike, the weights are a multiple of the mean movement code."""
    network, data = random_weights("acmt").eval(), inputs(patient("acmt"))
    network.features = lambda inputs: (torch.full((1, 64, 64), 0.5), torch.ones(1, 64, 64))
    with torch.no_grad():
        code = network.movement(torch.cat([data.bone.points, data.movement], 1)).mean(0)
        expected = network.displacement(32 * code)
        assert torch.allclose(network(data)[0].displacement[0], torch.sigmoid(expected) - 0.5, atol=1e-5)


@pytest.mark.parametrize("difference", [False, True])
def test_edge_convolution_is_torch_geometrics(difference):
    torch.manual_seed(0)
    ours = EdgeConvolution(5, difference)
    values, edges = torch.randn(30, 5), torch.randint(0, 30, (2, 200))
    theirs = EdgeConv(nn.Sequential(ours.first, *ours.rest), aggr="mean")
    if difference:
        theirs.message = lambda x_i, x_j: theirs.nn(x_j - x_i)
    assert torch.allclose(ours(values, edges), theirs(values, edges), atol=1e-5)


def test_mixed_precision_is_near_full_precision():
    data, fields = inputs(patient("dgcfp")), []
    for mixed in (False, True):
        network = random_weights("dgcfp").eval()
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=mixed):
            torch.manual_seed(0)
            fields.append(network(data)[-1].displacement)
    assert fields[1].dtype == torch.float32
    assert (fields[0] - fields[1]).abs().max() < 0.05 * fields[0].abs().max()


def test_mirroring_flips_places_and_movement_everywhere():
    flip = torch.tensor([-1.0, 1.0, 1.0])
    for architecture in ARCHITECTURES:
        data = inputs(patient(architecture))
        other = scaled(data, flip)
        assert torch.equal(other.movement, data.movement * flip)
        for one, two in zip(data.face.levels, other.face.levels, strict=True):
            assert torch.equal(two.points, one.points * flip)
        assert torch.equal(scaled(other, flip).bone.points, data.bone.points)
