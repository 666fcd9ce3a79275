"""Orthogonal steps: what they are, that they agree with torch's, and which parameters take them."""

import copy

import torch
from torch import nn

from pinnochio.training.muon import Muon, orthogonalised


def _network() -> nn.Module:
    torch.manual_seed(3)
    return nn.Sequential(nn.Linear(16, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh(), nn.Linear(32, 3))


def _descend(network: nn.Module, optimiser: torch.optim.Optimizer, steps: int = 20) -> None:
    places = torch.randn(200, 16, generator=torch.Generator().manual_seed(4))
    wanted = torch.sin(places[:, :3]) + places[:, 3:6]
    for _ in range(steps):
        loss = ((network(places) - wanted) ** 2).mean()
        network.zero_grad()
        loss.backward()
        optimiser.step()


def test_orthogonal_matrices_keep_their_singular_vectors():
    """Tall, wide and square ones, whose singular values differ by a factor of a hundred."""
    for rows, columns in ((12, 12), (8, 30), (30, 8)):
        left = torch.linalg.qr(torch.randn(3, rows, min(rows, columns))).Q
        right = torch.linalg.qr(torch.randn(3, columns, min(rows, columns))).Q
        values = torch.logspace(0, -2, min(rows, columns))
        made = orthogonalised((left * values) @ right.mT)
        turned = left.mT @ made @ right
        assert torch.allclose(turned, torch.diag_embed(turned.diagonal(dim1=1, dim2=2)), atol=2e-3)
        assert ((turned.diagonal(dim1=1, dim2=2) - 0.95).abs() < 0.3).all()


def test_a_step_is_that_of_torch():
    """Its Muon calculates in bfloat16: 5 % of a step."""
    torch.manual_seed(3)
    ours = nn.Linear(16, 3 * 16)
    theirs, start = copy.deepcopy(ours), copy.deepcopy(ours)
    settings = {"lr": 1e-2, "weight_decay": 0.1}
    matrix, bias = theirs.parameters()
    muon = torch.optim.Muon([matrix], lr=3e-2, weight_decay=0.1, adjust_lr_fn="match_rms_adamw")
    for network, *optimisers in (
        (ours, Muon(ours.parameters(), 3, **settings)),
        (theirs, muon, torch.optim.AdamW([bias], **settings)),
    ):
        places = torch.randn(200, 16, generator=torch.Generator().manual_seed(4))
        (network(places) ** 2).sum().backward()
        for optimiser in optimisers:
            optimiser.step()
    for one, other, rest in zip(ours.parameters(), theirs.parameters(), start.parameters(), strict=True):
        assert (one - other).norm() < 0.05 * (other - rest).norm()


def test_a_resumed_run_steps_as_an_unbroken_one():
    unbroken, broken = _network(), _network()
    _descend(unbroken, Muon(unbroken.parameters(), 3, lr=1e-2), steps=9)
    first = Muon(broken.parameters(), 3, lr=1e-2)
    _descend(broken, first, steps=5)
    second = Muon(broken.parameters(), 3, lr=1e-2)
    second.load_state_dict(copy.deepcopy(first.state_dict()))
    _descend(broken, second, steps=4)
    for one, other in zip(unbroken.parameters(), broken.parameters(), strict=True):
        assert torch.equal(one, other)


def test_a_matrix_without_gradient_stays():
    network = _network()
    network[0].requires_grad_(False)
    before = network[0].weight.clone()
    _descend(network, Muon(network.parameters(), 3, lr=1e-2, weight_decay=0.5))
    assert torch.equal(network[0].weight, before)
