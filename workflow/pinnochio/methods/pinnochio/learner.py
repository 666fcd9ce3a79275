"""Pretraining, fine-tuning and prediction, from files to files."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.errors import InputError
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.materials import Material
from pinnochio.methods.pinnochio.execution import execution_fields
from pinnochio.methods.pinnochio.losses import SurfaceLoss, boundary_loss, bulk_factor, physics_loss, volume_loss
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.cascade import PlanSignal, Prediction, build
from pinnochio.networks.settings import NetworkSettings
from pinnochio.plans.plan import Plan
from pinnochio.seeds import derive_seed
from pinnochio.timing import timed
from pinnochio.training.checkpoint import load_network, save_network
from pinnochio.training.loop import Step, Terms, train
from pinnochio.training.settings import TrainingSettings
from pinnochio.training.validation import held_back


class Mechanics(Protocol):
    """What the physics loss needs of the finite-element settings."""

    volumetric: str

    def material(self, tissue: np.ndarray) -> Material: ...


@dataclass(frozen=True)
class CaseFiles:
    """Files of one training patient: model and, for a network with a lift, its lift; the teacher's fields, or the plan
    and the post-operative skin."""

    case: str
    model: str | os.PathLike
    lift: str | os.PathLike | None = None
    fem_samples: str | os.PathLike | None = None
    plan: str | os.PathLike | None = None
    postop: str | os.PathLike | None = None


def pretrain_fold(
    cases: Sequence[CaseFiles],
    network: NetworkSettings,
    training: TrainingSettings,
    mechanics: Mechanics,
    *,
    seed: int,
    device: str,
    out: str | os.PathLike,
    history: str | os.PathLike,
) -> None:
    """Train a new network on the cases' finite-element fields; write it to `out` and the losses to `history`.

    Loss: volumetric squared error, equilibrium residual and boundary mismatch, anchored to the teacher.
    """
    samples, checks = [], []
    for files, held in zip(cases, held_back([files.case for files in cases], training.validation), strict=True):
        patient = read_patient(files, mechanics, network, device)
        for plan, field in read_fem_samples(files):
            sample = patient, patient.signal(plan), torch.as_tensor(field, dtype=torch.float32, device=device)
            (checks if held else samples).append(sample)
    torch.manual_seed(derive_seed(seed, "pretrain", "weights"))
    model = build(network).to(device)

    def terms(sample, step):
        patient, signal, field = samples[sample]
        prediction = model(patient.anatomy, signal, step.mirror)
        anchored = torch.ones_like(prediction.known)
        data = volume_loss(prediction.displacement, field)
        return _terms(patient, prediction, data, field, anchored, training, step)

    def validate():
        errors = [volume_loss(model(patient.anatomy, signal).displacement, field) for patient, signal, field in checks]
        return torch.stack(errors).mean().item()

    logging.info("pretrain: %d patients, %d fields, %d held back", len(cases), len(samples), len(checks))
    run_phase(
        model, network, averaged(terms), len(samples), training, "pretrain", seed, out, history,
        validate if checks else None, [path for files in cases for path in (files.model, files.fem_samples)],
    )  # fmt: skip


def finetune_fold(
    cases: Sequence[CaseFiles],
    pretrained: str | os.PathLike,
    training: TrainingSettings,
    mechanics: Mechanics,
    *,
    seed: int,
    device: str,
    out: str | os.PathLike,
    history: str | os.PathLike,
) -> None:
    """Adapt the network at `pretrained` to the cases' post-operative skins, and to nothing else of the outcome.

    Loss: equilibrium residual, Chamfer distance and boundary mismatch, anchored to the reference cue.
    """
    model, network = load_network(pretrained, device)
    if training.execution_prior and network.lift == "none":
        raise ValueError("execution_prior needs a network with a lift, which carries the segments' errors to the skin")
    samples, checks = [], []
    for files, held in zip(cases, held_back([files.case for files in cases], training.validation), strict=True):
        patient = read_patient(files, mechanics, network, device)
        surface = read_surface_loss(files, patient, training)
        sample = patient, patient.signal(Plan.read(files.plan, files.case)), surface
        (checks if held else samples).append(sample)

    errors = [0.0] * len(samples)
    if training.execution_prior:
        errors = execution_fields(samples, training.execution_prior, seed)

    def terms(sample, step):
        patient, signal, surface = samples[sample]
        prediction = model(patient.anatomy, signal, step.mirror)
        data = surface(prediction.displacement + errors[sample], step.rng)
        return _terms(patient, prediction, data, signal.cue, signal.reliable, training, step)

    def validate():
        errors = [
            surface(model(patient.anatomy, signal).displacement, np.random.default_rng(0))
            for patient, signal, surface in checks
        ]
        return torch.stack(errors).mean().item()

    logging.info("finetune: %d patients, %d held back", len(samples), len(checks))
    run_phase(
        model, network, averaged(terms), len(samples), training, "finetune", seed, out, history,
        validate if checks else None, [path for files in cases for path in (files.model, files.plan, files.postop)],
    )  # fmt: skip


class Predictor:
    """A trained network on one patient: what belongs to the patient is computed once and serves every plan.

    On a GPU the first plan records the kernels, and every later one replays them without the cost of their launches.
    """

    def __init__(self, network: nn.Module, patient: PatientTensors):
        self.network, self.patient, self._recorded = network, patient, None
        with torch.inference_mode():
            self._rest = network.encode_rest(patient.anatomy)

    def __call__(self, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n, 3) mm of every node, and of the interface nodes as P_bnd gives it, float64.

        FloatingPointError if the network gives no number.
        """
        with torch.inference_mode():
            found = self._run(self.patient.signal(plan))
            # A node of which no boundary network speaks has its own displacement.
            boundary = torch.where(found.known > 0, found.boundary, found.displacement)
            displacement, boundary = (x.cpu().numpy().astype(float) for x in (found.displacement, boundary))
        if not np.isfinite(displacement).all():
            raise FloatingPointError(f"case {plan.case!r}: the predicted displacement is not finite")
        return displacement, boundary

    def _run(self, signal: PlanSignal) -> Prediction:
        def once(given):
            return self.network(self.patient.anatomy, given, rest=self._rest)

        if not signal.cue.is_cuda:
            return once(signal)
        if self._recorded is None:
            aside = torch.cuda.Stream()
            aside.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(aside):  # compiles, and finds the layouts of the graphs
                once(signal)
            torch.cuda.current_stream().wait_stream(aside)
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph):
                found = once(signal)
            self._recorded = graph, signal, found
        graph, given, found = self._recorded
        for old, new in zip(vars(given).values(), vars(signal).values(), strict=True):
            if new is not None and new is not old:
                old.copy_(new)
        graph.replay()
        return found


def predict(network: nn.Module, patient: PatientTensors, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """As a :class:`Predictor` of the patient, for one plan."""
    return Predictor(network, patient)(plan)


def predict_case(
    network: nn.Module,
    settings: NetworkSettings,
    mechanics: Mechanics,
    model: PatientModel,
    plan: Plan,
    device: str,
    lift: Lift | None = None,
    finish: Callable[[np.ndarray, np.ndarray], object] = lambda *fields: fields,
):
    """finish(displacement, boundary) of a plan, seconds of one warm plan (see timed), seconds of the patient.

    `finish` is what becomes of the network's fields (n, 3) mm before they are given out, and is timed with them.
    """

    def prepare():
        predictor = Predictor(network, tensors(model, mechanics, settings, device, lift))
        return lambda: finish(*predictor(plan))

    found, seconds, setup = timed(prepare)
    return found, seconds, setup + (lift.seconds if lift else 0.0)


def tensors(
    model: PatientModel, mechanics: Mechanics, network: NetworkSettings, device: str, lift: Lift | None = None
) -> PatientTensors:
    """The model as tensors, with the material of `mechanics`."""
    material = mechanics.material(model.tissue)
    return PatientTensors.build(model, material, mechanics.volumetric, network, lift, device)


def read_patient(files: CaseFiles, mechanics: Mechanics, network: NetworkSettings, device: str) -> PatientTensors:
    """Read a patient's model and, if the network wants one, its lift; build its tensors."""
    lift = None
    if network.lift != "none":
        if files.lift is None:
            raise InputError(files.case, files.model, f"the network wants a lift, {network.lift}", "make it first")
        lift = Lift.read(files.lift)
    return tensors(PatientModel.read(files.model), mechanics, network, device, lift)


def read_fem_samples(files: CaseFiles) -> list[tuple[Plan, np.ndarray]]:
    """Plans and displacement fields (n, 3) mm of the teacher, in the order of their numbers."""
    with h5py.File(files.fem_samples, "r") as file:
        groups = sorted(file, key=lambda name: int(name.rsplit("_", 1)[-1]))
        found = [
            (Plan.from_json(file[name].attrs["plan"], files.fem_samples), file[name]["displacement"][()])
            for name in groups
            if file[name].attrs.get("converged", True)
        ]
    if not found:
        raise InputError(files.case, files.fem_samples, "holds no converged field", "simulate more plans")
    return found


def read_surface_loss(files: CaseFiles, patient: PatientTensors, training: TrainingSettings) -> SurfaceLoss:
    """The Chamfer term against the case's post-operative skin, tried once on the patient at rest."""
    try:
        loss = SurfaceLoss(
            patient, *PostopSkin.read(files.postop).surface, training.surface_samples, training.surface_cutoff
        )
        loss(torch.zeros_like(patient.points), np.random.default_rng(0))
    except ValueError as error:
        remedy = "check registration and face region"
        raise InputError(files.case, files.postop, str(error), remedy) from error
    return loss


def _terms(
    patient: PatientTensors,
    prediction: Prediction,
    data: Tensor,
    anchor: Tensor,
    anchored: Tensor,
    training: TrainingSettings,
    step: Step,
) -> dict[str, Tensor]:
    found = {"data": data, "boundary": boundary_loss(prediction, anchor, anchored)}
    if step.physics:
        bulk = bulk_factor(patient.operator, training.poisson_start, step.anneal)
        found["physics"] = physics_loss(
            patient.operator, patient.free, prediction.displacement, training.physics_robust, bulk
        )
    return found


def averaged(terms: Callable[[int, Step], Mapping[str, Tensor]]) -> Terms:
    """The terms of a step, each the mean over its samples of terms(sample, step)."""

    def mean(step: Step) -> dict[str, Tensor]:
        found = [terms(sample, step) for sample in step.samples]
        return {name: sum(own[name] for own in found) / len(found) for name in found[0]}

    return mean


def run_phase(model, network, terms, samples, training, phase, seed, out, history, validate, inputs):
    """Train, write the network, then drop the checkpoint, so that a kill at any time costs little."""
    checkpoint = Path(out).with_suffix(".resume.pt")
    train(
        model, terms, samples, training, phase=phase, seed=seed, checkpoint=checkpoint, history=history,
        validate=validate, inputs=inputs,
    )  # fmt: skip
    save_network(out, model, network, training=_plain(training), seed=seed)
    checkpoint.unlink(missing_ok=True)


def _plain(training: TrainingSettings) -> dict:
    return asdict(training) | {"weights": dict(training.weights)}
