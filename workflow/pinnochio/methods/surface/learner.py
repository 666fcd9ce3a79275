"""Pretraining, adaptation and prediction of the surface networks, from files to files.

The protocol is PINNOCHIO's own: the same folds, plans, finite-element fields and registered skins, the same loop with
checkpoints, held-back patient and early stopping. What differs is the network, what it reads and its loss.
"""

import logging
import os
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.errors import InputError
from pinnochio.geometry.scattered import nearest, spread
from pinnochio.methods.pinnochio.learner import CaseFiles, read_fem_samples, run_phase
from pinnochio.methods.surface.losses import chamfer, density, laplacian_change, local_change
from pinnochio.methods.surface.patient import SurfacePatient, Target
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.acmt_net import AcmtNet, FscNet
from pinnochio.networks.clouds import Given, Stage, per_patient, scaled, to_device
from pinnochio.networks.contrast import contrast
from pinnochio.networks.dgcfp import Dgcfp
from pinnochio.plans.plan import Plan
from pinnochio.seeds import derive_seed
from pinnochio.timing import timed
from pinnochio.training.checkpoint import load_network
from pinnochio.training.loop import Step
from pinnochio.training.settings import TrainingSettings
from pinnochio.training.validation import held_back

MOMENTUM = 0.5, 0.2, 0.01  # of batch normalisation in ACMT-Net: at first, share after which it halves, least [S]


def build(settings: SurfaceSettings) -> nn.Module:
    """The network of the settings, freshly initialised from torch's random state."""
    if settings.architecture == "acmt":
        return AcmtNet(settings.softmax)
    return FscNet() if settings.architecture == "fscnet" else Dgcfp()


def run_network(network: nn.Module, settings: SurfaceSettings, given: Given) -> list[Stage]:
    """What the network makes of `given`, in the precision of the settings."""
    with torch.autocast(given.movement.device.type, torch.bfloat16, enabled=settings.mixed_precision):
        return network(given)


def pretrain_fold(
    cases: Sequence[CaseFiles],
    settings: SurfaceSettings,
    training: TrainingSettings,
    *,
    seed: int,
    device: str,
    out: str | os.PathLike,
    history: str | os.PathLike,
) -> None:
    """Train a new network on how the skin moves in the cases' finite-element fields. Loss: mean squared error, mm^2."""

    def read(files, patient):
        for plan, field in read_fem_samples(files):
            skin = patient.model.moved_skin(field) - patient.model.skin_points
            yield [(patient.given(draw, plan), patient.carried(draw, skin), patient.unit) for draw in patient.draws]

    samples, checks = _read(cases, settings, training.validation, read, device)
    torch.manual_seed(derive_seed(seed, "pretrain", "weights"))
    _train(
        build(settings).to(device), settings, samples, checks, field_loss, training, phase="pretrain", seed=seed,
        device=device, out=out, history=history, inputs=[path for own in cases for path in (own.model, own.fem_samples)],
    )  # fmt: skip


def finetune_fold(
    cases: Sequence[CaseFiles],
    pretrained: str | os.PathLike | None,
    settings: SurfaceSettings,
    training: TrainingSettings,
    *,
    seed: int,
    device: str,
    out: str | os.PathLike,
    history: str | os.PathLike,
) -> None:
    """Train the network at `pretrained`, or a new one, on the cases' post-operative skins, with its published loss."""

    def read(files, patient):
        skin = PostopSkin.read(files.postop)
        try:
            target = Target.build(patient, *skin.surface, settings, files.case)
        except ValueError as error:
            raise InputError(files.case, files.postop, str(error), "check registration and face region") from error
        plan = Plan.read(files.plan, files.case)
        yield [
            (patient.given(draw, plan), draw.pairs, seen, target.points, target.weight)
            for draw, seen in zip(patient.draws, target.seen, strict=True)
        ]

    samples, checks = _read(cases, settings, training.validation, read, device)
    if pretrained is None:
        torch.manual_seed(derive_seed(seed, "finetune", "weights"))
        network = build(settings).to(device)
    else:
        network, _ = load_surface_network(pretrained, device)
    _train(
        network, settings, samples, checks, skin_loss(settings), training, phase="finetune", seed=seed, device=device,
        out=out, history=history, inputs=[path for own in cases for path in (own.model, own.plan, own.postop)],
    )  # fmt: skip


def field_loss(stages, flip: Tensor, step: Step, target: Tensor, unit: float) -> Tensor:
    """Of pretraining: mean squared error of the displacement, mm^2."""
    return unit**2 * supervised(stages, target * flip)


def skin_loss(settings: SurfaceSettings) -> Callable:
    """Of adaptation: the published loss against points drawn from the target."""

    def loss(stages, flip, step, pairs, seen, points, weight):
        chosen = torch.as_tensor(step.rng.permutation(len(points))[: settings.points], device=points.device)
        return published(settings.architecture, stages, pairs, seen, points[chosen] * flip, weight[chosen])

    return loss


def supervised(stages: Sequence[Stage], target: Tensor) -> Tensor:
    """Mean squared error of a patient's displacement against the `target` (n, 3), mean over its stages.

    What a stage put between points goes as far as these in the mean.
    """
    found = []
    for stage in stages:
        if stage.corners is not None:
            target = torch.cat([target, target[stage.corners].mean(1)])
        found.append((stage.displacement - target).square().sum(1).mean())
    return torch.stack(found).mean()


def published(
    architecture: str, stages: Sequence[Stage], pairs: Tensor, seen: Tensor, target: Tensor, weight: Tensor
) -> Tensor:
    """The published loss of a patient: shape, density and local terms, or DGCFP's at both of its stages.

    pairs (p, 2), seen (n,): see Draw and Target; target (t, 3) in units with weight (t,).
    """
    total = 0.0
    for stage in stages:
        moved = stage.rest + stage.displacement
        if architecture != "dgcfp":
            shape = chamfer(moved, target, seen, weight) + 0.05 * density(moved, target)
            return shape + 5 * local_change(stage.rest, moved, pairs)
        if stage.corners is not None:
            seen = torch.cat([seen, seen[stage.corners].amin(1)])
        total += chamfer(moved, target, seen, weight, squared=True) + 0.3 * density(moved, target, squared=True)
        total += 0.05 * laplacian_change(stage.displacement, stage.edges)
    return total


class Predictor:
    """A trained surface network on one patient: its points are drawn once and serve every plan."""

    def __init__(self, network: nn.Module, settings: SurfaceSettings, model: PatientModel, case: str, device: str):
        self.network, self.settings, self.device = network.eval(), settings, device
        self.patient = SurfacePatient.build(model, settings, case, repeats=1)
        self._ways = None

    def __call__(self, plan: Plan) -> np.ndarray:
        """Displacement (s, 3) mm of the skin points, interpolated from the nearest face points.

        FloatingPointError if the network gives no number.
        """
        torch.manual_seed(0)  # DGCFP draws triangles
        draw = self.patient.draws[0]
        with torch.inference_mode():
            given = to_device(self.patient.given(draw, plan), self.device)
            stage = run_network(self.network, self.settings, given)[-1]
            rest, moved = (x.cpu().numpy().astype(float) for x in (stage.rest, stage.displacement))
        if not np.isfinite(moved).all():
            raise FloatingPointError(f"case {plan.case!r}: the predicted displacement is not finite")
        if self._ways is None:  # where points were is the same under every plan
            skin = (self.patient.model.skin_points - self.patient.centre) / self.patient.unit
            self._ways = nearest(skin, rest)
        return spread(moved, *self._ways) * self.patient.unit


def predict_case(
    network: nn.Module, settings: SurfaceSettings, model: PatientModel, plan: Plan, device: str
) -> tuple[np.ndarray, float, float]:
    """Displacement (s, 3) mm of the skin points, seconds of one warm plan (see timed), seconds of the patient."""
    return timed(lambda: partial(Predictor(network, settings, model, plan.case, device), plan))


def load_surface_network(path: str | os.PathLike, device: str = "cpu") -> tuple[nn.Module, SurfaceSettings]:
    """As load_network, of a surface network."""
    return load_network(path, device, SurfaceSettings, build)


def _read(cases: Sequence[CaseFiles], settings: SurfaceSettings, validation: int, read: Callable, device: str):
    """What is trained on and what is held back: for each plan, (given, *known) of each draw of its patient.

    read(files, patient) gives these for each plan; the first is what the network reads, the others what the loss knows.
    """
    samples, checks = [], []
    for files, held in zip(cases, held_back([files.case for files in cases], validation), strict=True):
        patient = SurfacePatient.build(PatientModel.read(files.model), settings, files.case, settings.repeats)
        for draws in read(files, patient):
            (checks if held else samples).append([to_device(draw, device) for draw in draws])
    return samples, checks


def _train(
    network: nn.Module,
    settings: SurfaceSettings,
    samples: Sequence,
    checks: Sequence,
    loss: Callable,
    training: TrainingSettings,
    *,
    phase: str,
    seed: int,
    device: str,
    out: str | os.PathLike,
    history: str | os.PathLike,
    inputs: Sequence[str | os.PathLike] = (),
) -> None:
    """Train with loss(stages, flip, step, *known) of each patient of a step; samples and checks: see :func:`_read`."""
    flips = torch.tensor([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]], device=device)

    def run(shown, step):
        flip = flips[int(step.mirror)]
        given = scaled(Given.join([own[0] for own in shown]), flip)
        torch.manual_seed(int(step.rng.integers(2**31)))  # DGCFP drops edges and draws triangles
        parts = per_patient(run_network(network, settings, given), len(shown))
        own = [loss(part, flip, step, *known[1:]) for part, known in zip(parts, shown, strict=True)]
        data = torch.stack(own).mean()
        if settings.contrast and phase == "pretrain":
            data = data + settings.contrast * contrast(network, given)
        return {"data": data}

    def terms(step):
        if settings.architecture != "dgcfp":
            set_momentum(network, step.share)
        return run([samples[n][step.rng.integers(settings.repeats)] for n in step.samples], step)

    def validate():
        still = Step((0,), False, False, 1.0, 1.0, np.random.default_rng(0))
        return torch.stack([run(draws[:1], still)["data"] for draws in checks]).mean().item()

    logging.info("%s: %d plans, %d held back", phase, len(samples), len(checks))
    run_phase(
        network, settings, terms, len(samples), training, phase, seed, out, history,
        validate if checks else None, inputs,
    )  # fmt: skip


def set_momentum(network: nn.Module, share: float) -> None:
    """Batch normalisation as in ACMT-Net: its averages take on less and less of a batch as training goes on."""
    first, every, least = MOMENTUM
    for module in network.modules():
        if isinstance(module, nn.BatchNorm1d):
            module.momentum = max(first * 0.5 ** int(share / every), least)
