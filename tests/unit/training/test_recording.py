"""RecordedGradients steps: the same gradients as plain ones, made of functions whose shapes depend on no value."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from torch._subclasses.fake_tensor import FakeTensorMode

from pinnochio.methods.pinnochio.learner import GraphLearner
from pinnochio.methods.pinnochio.losses import SurfaceLoss
from pinnochio.networks.gatv2 import Attention
from pinnochio.training.loop import Step
from pinnochio.training.recording import RecordedGradients
from tests.helpers.training import FEM, SMALL, TRAINING, make_cases, run

WEIGHTS = {"physics": 0.5, "data": 2.0, "boundary": 1.0}
PHASES = ("pretrain", "finetune")


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return make_cases(tmp_path_factory.mktemp("inputs"))


def learner_and_network(phase):
    settings = {"network": asdict(SMALL), "fem": FEM} | dict.fromkeys(("pretraining", "finetuning"), asdict(TRAINING))
    learner = GraphLearner(settings, phase, "cpu")
    torch.manual_seed(0)
    network = learner.build(learner.network)
    with torch.no_grad():  # decoders begin at zero, behind which nothing has a gradient
        for weight in network.parameters():
            weight.add_(0.01 * torch.randn_like(weight))
    return learner, network


def step(mirror=False, seed=1):
    return Step((0, 2), mirror, True, 0.0, np.random.default_rng(seed))


@pytest.mark.parametrize("phase", PHASES)
def test_gradients_and_terms_are_those_of_a_plain_step(cases, phase):
    """Of two samples, mirrored and then not: what the first call left is gone."""
    learner, network = learner_and_network(phase)
    samples = [sample for files in cases for sample in learner.read(files)]
    recorded = RecordedGradients(network, lambda index, shown: learner.piece(network, samples[index], shown))
    for mirror in (True, False):
        values = recorded(step(mirror), WEIGHTS)
        gradient_values = [weight.grad.clone() for weight in network.parameters()]
        terms = learner.terms(network, [samples[0], samples[2]], step(mirror))
        total = sum(WEIGHTS[name] * value for name, value in terms.items())
        expected = torch.autograd.grad(total, list(network.parameters()))
        for name, value in terms.items():
            assert values[name].item() == pytest.approx(value.item(), rel=1e-6)
        for one, other in zip(gradient_values, expected, strict=True):
            assert torch.allclose(one, other, rtol=1e-4, atol=1e-6 * expected[0].abs().max())


@pytest.mark.parametrize("phase", ["pretrain", pytest.param("finetune", marks=pytest.mark.full)])
def test_training_by_recorded_steps_ends_where_plain_steps_do(cases, phase, tmp_path, monkeypatch):
    weights = []
    for recorded in (False, True):
        folder = tmp_path / str(recorded)
        run("pretrain", cases, folder)
        monkeypatch.setattr(GraphLearner, "recorded", recorded)
        run(phase, cases, folder)
        name = {"pretrain": "pretrained.pt", "finetune": "network.pt"}[phase]
        weights.append(torch.load(folder / name, weights_only=True)["state"])
        monkeypatch.undo()
    for name, value in weights[0].items():
        assert torch.allclose(value, weights[1][name], rtol=1e-3, atol=1e-5), name


@pytest.mark.parametrize("phase", PHASES)
def test_no_shape_and_no_branch_depends_on_a_value(cases, phase, monkeypatch):
    """Tensors without values refuse what a recording could not repeat: masks, lookups on the host, conditions."""
    learner, network = learner_and_network(phase)
    (sample,) = learner.read(cases[0])
    monkeypatch.setattr(Attention, "forward", Attention.general)
    if phase == "finetune":  # the branch of a GPU
        surface = sample.data.__self__
        monkeypatch.setattr(SurfaceLoss, "_on_gpu", lambda self: True)
        sample = replace(sample, data=surface.between)
    learner.piece(network, sample, step()).terms()  # as before a recording, which finds what is read of the graphs
    with FakeTensorMode(allow_non_fake_inputs=True) as mode:
        piece = learner.piece(network, sample, step())
        terms = replace(piece, inputs=tuple(mode.from_tensor(value) for value in piece.inputs)).terms()
        gradients = torch.autograd.grad(sum(terms.values()), list(network.parameters()))
    assert all(isinstance(gradient, torch._subclasses.FakeTensor) for gradient in gradients)


def test_the_distance_of_a_gpu_is_that_of_a_cpu(cases, monkeypatch):
    """Weights instead of a selection: the same pairs, the same mean, the same gradient."""
    learner, _ = learner_and_network("finetune")
    (sample,) = learner.read(cases[1])
    drawn, values = sample.draw(np.random.default_rng(0)), []
    for on_gpu in (False, True):
        monkeypatch.setattr(SurfaceLoss, "_on_gpu", lambda self, on_gpu=on_gpu: on_gpu)
        field = (0.5 * torch.ones_like(sample.patient.points)).requires_grad_()
        distance = sample.data(field, *drawn)
        values.append((distance.item(), torch.autograd.grad(distance, field)[0]))
    (one, slope), (other, same) = values
    assert one == pytest.approx(other, rel=1e-6) and one > 0.1
    assert torch.allclose(slope, same, atol=1e-6)
