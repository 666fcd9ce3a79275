"""Training of the surface networks: what a step shows of a patient, and its loss.

The protocol is PINNOCHIO's own: the same folds, plans, finite-element samples and registered skins, the same loop with
checkpoints, held-back patient and early stopping. What differs is the network, what it reads and its loss.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.errors import InputError
from pinnochio.methods.surface.architectures import AcmtArchitecture, architecture, build, run_network
from pinnochio.methods.surface.patient import SurfacePatient, SurfaceTarget
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.clouds import SurfaceInputs, SurfaceStage, per_patient, scaled, to_device
from pinnochio.networks.signals import mirror_signs
from pinnochio.plans.plan import Plan
from pinnochio.training.case_files import CaseFiles, read_fem_samples
from pinnochio.training.loop import Step
from pinnochio.training.settings import PHASES, TrainingSettings


@dataclass(frozen=True)
class FieldDraw:
    """A draw of a patient, and the displacement (n, 3) in units of its face points in a finite-element sample.

    unit in mm.
    """

    inputs: SurfaceInputs
    target: Tensor
    unit: float

    def loss(self, stages: Sequence[SurfaceStage], flip: Tensor, step: Step) -> Tensor:
        """Of pretraining: mean squared error of the displacement, mm^2."""
        return self.unit**2 * supervised(stages, self.target * flip)


@dataclass(frozen=True)
class SkinDraw:
    """A draw of a patient: pairs (p, 2) of points, weights seen (n,); the SurfaceTarget's points."""

    inputs: SurfaceInputs
    pairs: Tensor
    seen: Tensor
    points: Tensor
    architecture: AcmtArchitecture

    def loss(self, stages: Sequence[SurfaceStage], flip: Tensor, step: Step) -> Tensor:
        """Of fine-tuning: the published loss against points drawn from the target."""
        drawn = step.rng.permutation(len(self.points))[: self.architecture.settings.points]
        chosen = torch.as_tensor(drawn, device=self.points.device)
        return self.architecture.loss(stages, self.pairs, self.seen, self.points[chosen] * flip)


class SurfaceLearner:
    """As :class:`pinnochio.training.fold.Learner`; settings: network and those of the phase.

    A sample is a list of draws of one patient under one plan, of which a step shows one.
    """

    build = staticmethod(build)
    recorded = False  # every step joins other patients, whose balls differ in size

    def __init__(self, settings: Mapping, phase: str, device: str):
        """Adam without warm-up and weight decay, and one loss term."""
        self.device, self.network = device, SurfaceSettings(**settings["network"])
        plain = {"weights": {"physics": 0.0, "data": 1.0, "boundary": 0.0}, "warmup": 0.0, "weight_decay": 0.0}
        self.training = TrainingSettings(**settings[PHASES[phase]], **plain)
        self.read = self._fem_samples if phase == "pretrain" else self._outcome
        self._architecture = architecture(self.network)
        self._flips = mirror_signs().to(device)

    def completed(self, network: nn.Module, cases: Sequence[CaseFiles]) -> dict:
        """Nothing."""
        return {}

    def terms(self, network: nn.Module, samples: Sequence, step: Step) -> dict[str, Tensor]:
        """The data term alone."""
        self._architecture.set_momentum(network, step.share)
        return {"data": self._data(network, [draws[step.rng.integers(len(draws))] for draws in samples], step)}

    def error(self, network: nn.Module, samples: Sequence) -> Tensor:
        """The data term of each one's first draw."""
        still = Step((0,), False, False, 1.0, np.random.default_rng(0))
        return torch.stack([self._data(network, draws[:1], still) for draws in samples]).mean()

    def _fem_samples(self, files: CaseFiles) -> list[list[FieldDraw]]:
        """How the skin moves in each finite-element sample."""
        patient, samples = self._patient(files), []
        for plan, field in read_fem_samples(files.fem_samples, files.case):
            skin = patient.model.moved_skin(field) - patient.model.skin_points
            draws = patient.draws
            samples.append(
                [FieldDraw(patient.inputs(one, plan), patient.carried(one, skin), patient.unit) for one in draws]
            )
        return [[to_device(draw, self.device) for draw in draws] for draws in samples]

    def _outcome(self, files: CaseFiles) -> list[list[SkinDraw]]:
        """The patient's own plan with its post-operative skin."""
        patient, plan = self._patient(files), Plan.read(files.plan, files.case)
        try:
            target = SurfaceTarget.build(patient, *PostopSkin.read(files.postop).surface, self.network, files.case)
        except ValueError as error:
            raise InputError(files.case, files.postop, str(error), "check registration and face region") from error
        draws = [
            SkinDraw(patient.inputs(draw, plan), draw.pairs, seen, target.points, self._architecture)
            for draw, seen in zip(patient.draws, target.seen, strict=True)
        ]
        return [[to_device(draw, self.device) for draw in draws]]

    def _patient(self, files: CaseFiles) -> SurfacePatient:
        return SurfacePatient.build(PatientModel.read(files.model), self.network, files.case, self.network.repeats)

    def _data(self, network: nn.Module, draws: Sequence[FieldDraw | SkinDraw], step: Step) -> Tensor:
        """Mean loss of the patients of a step."""
        flip = self._flips[int(step.mirror)]
        inputs = scaled(SurfaceInputs.join([draw.inputs for draw in draws]), flip)
        torch.manual_seed(int(step.rng.integers(2**31)))  # DGCFP drops edges and draws triangles
        parts = per_patient(run_network(network, self.network, inputs), len(draws))
        return torch.stack([draw.loss(part, flip, step) for part, draw in zip(parts, draws, strict=True)]).mean()


def supervised(stages: Sequence[SurfaceStage], target: Tensor) -> Tensor:
    """Mean squared error of a patient's displacement against the `target` (n, 3), mean over its stages.

    What a stage put between points goes as far as these in the mean.
    """
    errors = []
    for stage in stages:
        if stage.corners is not None:
            target = torch.cat([target, target[stage.corners].mean(1)])
        errors.append((stage.displacement - target).square().sum(1).mean())
    return torch.stack(errors).mean()
