"""Training of the graph networks: what a step shows of a patient, and its loss."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.errors import InputError
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.adaptation import learned_sources
from pinnochio.methods.pinnochio.losses import SurfaceLoss, boundary_loss, physics_loss, volume_loss
from pinnochio.methods.pinnochio.patient import PatientTensors, tensors
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.building import build, matched
from pinnochio.networks.settings import NetworkSettings
from pinnochio.networks.signals import PlanSignal
from pinnochio.plans.plan import Plan
from pinnochio.training.case_files import CaseFiles, read_fem_samples
from pinnochio.training.loop import Step
from pinnochio.training.recording import Piece
from pinnochio.training.settings import PHASES, TrainingSettings


@dataclass(frozen=True)
class Sample:
    """A patient under a plan: data(displacement, *draw(rng)), the data term, and where the boundary belongs.

    anchor (n, 3) mm, on the nodes where anchored (n, 1) is 1.
    """

    patient: PatientTensors
    signal: PlanSignal
    data: Callable[..., Tensor]
    draw: Callable[[np.random.Generator], tuple[Tensor, ...]]
    anchor: Tensor
    anchored: Tensor


class GraphLearner:
    """As :class:`pinnochio.training.fold.Learner`; settings: network, fem and those of the phase.

    Loss: equilibrium residual, data and boundary mismatch. Pretraining: volumetric squared error, anchored to the
    finite-element sample; fine-tuning: Chamfer distance, anchored to the reference cue.
    """

    build = staticmethod(build)

    def __init__(self, settings: Mapping, phase: str, device: str):
        """ValueError where the phase does not fit the network."""
        self.device, self.network = device, NetworkSettings(**settings["network"])
        if self.network.match_parameters and not self.network.decomposition:
            self.network = matched(self.network)
        self._fem, self.training = FemSettings(**settings["fem"]), TrainingSettings(**settings[PHASES[phase]])
        self._corrections = settings.get("newton_corrections", 0)
        self.read = self._fem_samples if phase == "pretrain" else self._outcome

    @property
    def recorded(self) -> bool:
        """On a GPU."""
        return self.device == "cuda"

    def terms(self, network: nn.Module, samples: Sequence[Sample], step: Step) -> dict[str, Tensor]:
        """Each the mean over the samples."""
        each = [self.piece(network, sample, step).terms() for sample in samples]
        return {name: sum(terms[name] for terms in each) / len(each) for name in each[0]}

    def error(self, network: nn.Module, samples: Sequence[Sample]) -> Tensor:
        """The data term."""
        errors = []
        for sample in samples:
            displacement = network(sample.patient.anatomy, sample.signal).displacement
            errors.append(sample.data(displacement, *sample.draw(np.random.default_rng(0))))
        return torch.stack(errors).mean()

    def completed(self, network: nn.Module, cases: Sequence[CaseFiles]) -> dict[str, dict[str, Tensor]]:
        """The sources, over the network's corrected fields, where the settings ask for them."""
        if not self.training.sources:
            return {}
        patients = map(self._patient, cases)
        return {"sources": learned_sources(network, patients, cases, self._fem, self._corrections)}

    def _fem_samples(self, files: CaseFiles) -> list[Sample]:
        """One for each finite-element sample."""
        patient, samples = self._patient(files), []
        for plan, displacement in read_fem_samples(files.fem_samples, files.case):
            field = torch.as_tensor(displacement, dtype=torch.float32, device=self.device)
            everywhere = torch.ones_like(patient.reliable)
            samples.append(Sample(patient, patient.signal(plan), volume_loss, _always(field), field, everywhere))
        return samples

    def _outcome(self, files: CaseFiles) -> list[Sample]:
        """The patient's own plan with its post-operative skin, tried once on the patient at rest."""
        patient, skin = self._patient(files), PostopSkin.read(files.postop).surface
        try:
            surface = SurfaceLoss(patient, *skin, self.training.surface_samples, self.training.surface_cutoff)
            if not torch.isfinite(surface(torch.zeros_like(patient.points), np.random.default_rng(0))):
                raise ValueError("no point of the face is near the post-operative skin: is it registered?")
        except ValueError as error:
            raise InputError(files.case, files.postop, str(error), "check registration and face region") from error
        signal = patient.signal(Plan.read(files.plan, files.case))
        return [Sample(patient, signal, surface.between, surface.draw, signal.cue, signal.reliable)]

    def _patient(self, files: CaseFiles) -> PatientTensors:
        """Tensors of a patient's model and, if the network wants one, its lift."""
        wanted = self.network.lift != "none"
        if wanted and files.lift is None:
            raise InputError(files.case, files.model, f"the network wants a lift, {self.network.lift}", "make it first")
        lift = Lift.read(files.lift) if wanted else None
        return tensors(PatientModel.read(files.model), self._fem, self.network, self.device, lift)

    def piece(self, network: nn.Module, sample: Sample, step: Step) -> Piece:
        """The loss of a sample: the same function for all plans of a patient, mirrored or not."""
        patient, mirror, data = sample.patient, step.mirror, sample.data
        shown = {name: value for name, value in vars(sample.signal).items() if value is not None}

        def function(anchor, anchored, *rest):
            signal, drawn = rest[: len(shown)], rest[len(shown) :]
            prediction = network(patient.anatomy, PlanSignal(**dict(zip(shown, signal, strict=True))), mirror)
            terms = {
                "data": data(prediction.displacement, *drawn),
                "boundary": boundary_loss(prediction, anchor, anchored),
            }
            if step.physics:
                terms["physics"] = physics_loss(patient.operator, patient.free, prediction.displacement)
            return terms

        inputs = (sample.anchor, sample.anchored, *shown.values(), *sample.draw(step.rng))
        return Piece((id(patient), data, mirror), inputs, function)


def _always(*values: Tensor) -> Callable[[np.random.Generator], tuple[Tensor, ...]]:
    return lambda rng: values
