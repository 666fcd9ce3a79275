"""Pretraining, fine-tuning and prediction, from files to files."""

import logging
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
import torch
from torch import Tensor, nn

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.errors import InputError
from pinnochio.mechanics.materials import Material
from pinnochio.networks.cascade import Prediction, build
from pinnochio.networks.settings import NetworkSettings
from pinnochio.seeds import derive_seed
from pinnochio.training.checkpoint import load_network, save_network
from pinnochio.training.loop import train
from pinnochio.training.losses import SurfaceLoss, boundary_loss, physics_loss, volume_loss
from pinnochio.training.patient import PatientTensors
from pinnochio.training.settings import TrainingSettings


class Mechanics(Protocol):
    """What the physics loss needs of the finite-element settings."""

    volumetric: str

    def material(self, tissue: np.ndarray) -> Material: ...


@dataclass(frozen=True)
class CaseFiles:
    """Files of one training patient: model, then the teacher's fields or the plan and the post-operative skin."""

    case: str
    model: str | os.PathLike
    teaching: str | os.PathLike | None = None
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
    samples = []
    for files in cases:
        patient = read_patient(files.model, mechanics, network, device)
        for plan, field in read_teaching(files):
            signal = patient.signal(plan)
            samples.append((patient, signal, torch.as_tensor(field, dtype=torch.float32, device=device)))
    torch.manual_seed(derive_seed(seed, "pretrain", "weights"))
    model = build(network).to(device)

    def terms(index, physics, mirror, rng):
        patient, signal, field = samples[index]
        prediction = model(patient.anatomy, signal, mirror)
        anchored = torch.ones_like(prediction.known)
        data = volume_loss(prediction.displacement, field)
        return _terms(patient, prediction, data, field, anchored, physics)

    logging.info("pretrain: %d patients, %d fields", len(cases), len(samples))
    ramp = training.physics_ramp
    _run(model, terms, len(samples), training, "pretrain", seed, ramp, out, history)
    save_network(out, model, network, training=_plain(training), seed=seed)


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
    samples = []
    for files in cases:
        patient = read_patient(files.model, mechanics, network, device)
        surface = read_surface_loss(files, patient, training)
        samples.append((patient, patient.signal(Plan.read(files.plan, files.case)), surface))

    def terms(index, physics, mirror, rng):
        patient, signal, surface = samples[index]
        prediction = model(patient.anatomy, signal, mirror)
        data = surface(prediction.displacement, rng)
        return _terms(patient, prediction, data, signal.cue, signal.reliable, physics)

    logging.info("finetune: %d patients", len(cases))
    _run(model, terms, len(samples), training, "finetune", seed, 0.0, out, history)
    save_network(out, model, network, training=_plain(training), seed=seed)


def predict(network: nn.Module, patient: PatientTensors, plan: Plan) -> np.ndarray:
    """Displacement (n, 3) mm, float64, of every node; FloatingPointError if the network gives no number."""
    with torch.inference_mode():
        displacement = network(patient.anatomy, patient.signal(plan)).displacement
    values = displacement.cpu().numpy().astype(float)
    if not np.isfinite(values).all():
        raise FloatingPointError(f"case {plan.case!r}: the predicted displacement is not finite")
    return values


def predict_case(
    network: nn.Module, settings: NetworkSettings, mechanics: Mechanics, model: PatientModel, plan: Plan, device: str
) -> tuple[np.ndarray, float, float]:
    """Displacement (n, 3) mm, seconds of one warm plan, and seconds that belong to the patient."""
    start = time.perf_counter()
    patient = tensors(model, mechanics, settings, device)
    predict(network, patient, plan)
    setup = time.perf_counter() - start
    start = time.perf_counter()
    displacement = predict(network, patient, plan)
    return displacement, time.perf_counter() - start, setup


def tensors(model: PatientModel, mechanics: Mechanics, network: NetworkSettings, device: str) -> PatientTensors:
    """The model as tensors, with the material of `mechanics`."""
    return PatientTensors.build(
        model, mechanics.material(model.tissue), mechanics.volumetric, network.neighbours, device
    )


def read_patient(path, mechanics: Mechanics, network: NetworkSettings, device: str) -> PatientTensors:
    """Read a patient model and build its tensors."""
    return tensors(PatientModel.read(path), mechanics, network, device)


def read_teaching(files: CaseFiles) -> list[tuple[Plan, np.ndarray]]:
    """Plans and displacement fields (n, 3) mm of the teacher, in the order of their numbers."""
    with h5py.File(files.teaching, "r") as file:
        groups = sorted(file, key=lambda name: int(name.rsplit("_", 1)[-1]))
        found = [
            (Plan.from_json(file[name].attrs["plan"], files.teaching), file[name]["displacement"][()])
            for name in groups
            if file[name].attrs.get("converged", True)
        ]
    if not found:
        raise InputError(files.case, files.teaching, "holds no converged field", "simulate more plans")
    return found


def read_surface_loss(files: CaseFiles, patient: PatientTensors, training: TrainingSettings) -> SurfaceLoss:
    """The Chamfer term against the case's post-operative skin, tried once on the patient at rest."""
    with h5py.File(files.postop, "r") as file:
        points, faces = file["points"][()], file["faces"][()]
    try:
        loss = SurfaceLoss(patient, points, faces, training.surface_samples, training.surface_cutoff)
        loss(torch.zeros_like(patient.points), np.random.default_rng(0))
    except ValueError as error:
        remedy = "check registration and face region"
        raise InputError(files.case, files.postop, str(error), remedy) from error
    return loss


def count_weights(network: nn.Module) -> int:
    """Number of trained parameters."""
    return sum(weight.numel() for weight in network.parameters())


def _terms(
    patient: PatientTensors, prediction: Prediction, data: Tensor, anchor: Tensor, anchored: Tensor, physics: float
) -> dict[str, Tensor]:
    found = {"data": data, "boundary": boundary_loss(prediction, anchor, anchored)}
    if physics:
        found["physics"] = physics_loss(patient, prediction.displacement)
    return found


def _run(model, terms, samples, training, phase, seed, ramp, out, history):
    checkpoint = Path(out).with_suffix(".resume.pt")
    train(
        model, terms, samples, training, phase=phase, seed=seed, ramp=ramp, checkpoint=checkpoint,
        history=history
    )  # fmt: skip


def _plain(training: TrainingSettings) -> dict:
    return asdict(training) | {"weights": dict(training.weights)}
