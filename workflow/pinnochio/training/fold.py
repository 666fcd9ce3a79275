"""Training of a fold's network in two phases: pretraining on finite-element samples, fine-tuning on outcomes."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from pinnochio.seeds import derive_seed
from pinnochio.training.cases import CaseFiles, File
from pinnochio.training.checkpoint import read_network, save_network
from pinnochio.training.loop import Step, train
from pinnochio.training.settings import TrainingSettings
from pinnochio.training.validation import held_back


class Learner(Protocol):
    """A method that trains by steps, made of its settings (values by section) and the device.

    network: plain values, a dataclass that is stored with the network. A sample is what one step shows of one patient
    and plan; its kind is the learner's own.
    """

    device: str
    network: Any

    def training(self, phase: str) -> TrainingSettings:
        """Of the "pretraining" or the "finetuning"."""

    def build(self, network: Any) -> nn.Module:
        """The network of such plain values, freshly initialised from torch's random state."""

    def fem_samples(self, files: CaseFiles) -> list:
        """A sample for each of the patient's finite-element samples."""

    def outcomes(self, files: CaseFiles) -> list:
        """A sample of the patient's own plan and post-operative skin; InputError where the two do not fit."""

    def explained(self, samples: list, seed: int) -> list:
        """The training samples of fine-tuning, freed of what no plan explains."""

    def terms(self, network: nn.Module, samples: Sequence, step: Step) -> Mapping[str, Tensor]:
        """Loss terms of the samples of a step, see :func:`~pinnochio.training.loop.train`."""

    def error(self, network: nn.Module, samples: Sequence) -> Tensor:
        """Mean error of the network on samples that are not trained on; the same at every call."""


def pretrain_fold(
    learner: Learner, cases: Sequence[CaseFiles], *, seed: int, code: str, out: File, history: File
) -> None:
    """Train a new network on the cases' finite-element samples; write it to `out` and the losses to `history`.

    code: hash of the code that trains, see :func:`~pinnochio.training.loop.train`.
    """
    training = learner.training("pretraining")
    samples, checks = _read(cases, training.validation, learner.fem_samples)
    network = _new(learner, seed, "pretrain")
    inputs = [path for files in cases for path in (files.model, files.fem_samples)]
    _train(
        learner, network, samples, checks, training, "pretrain", inputs, seed=seed, code=code, out=out, history=history
    )


def finetune_fold(
    learner: Learner,
    cases: Sequence[CaseFiles],
    pretrained: File | None,
    *,
    seed: int,
    code: str,
    out: File,
    history: File,
) -> None:
    """Adapt the network at `pretrained`, or a new one, to the cases' post-operative skins, and to nothing else of the
    outcome; the rest as of :func:`pretrain_fold`.
    """
    training = learner.training("finetuning")
    samples, checks = _read(cases, training.validation, learner.outcomes)
    if pretrained is None:
        network = _new(learner, seed, "finetune")
    else:
        network, _ = read_network(pretrained, type(learner.network), learner.build, learner.device)
    samples = learner.explained(samples, seed)
    inputs = [path for files in cases for path in (files.model, files.plan, files.postop)]
    _train(
        learner, network, samples, checks, training, "finetune", inputs, seed=seed, code=code, out=out, history=history
    )


def _read(cases: Sequence[CaseFiles], validation: int, read: Callable[[CaseFiles], list]) -> tuple[list, list]:
    """Samples that are trained on, and those of the patients that are held back."""
    samples, checks = [], []
    for files, held in zip(cases, held_back([files.case for files in cases], validation), strict=True):
        (checks if held else samples).extend(read(files))
    return samples, checks


def _new(learner: Learner, seed: int, phase: str) -> nn.Module:
    torch.manual_seed(derive_seed(seed, phase, "weights"))
    return learner.build(learner.network).to(learner.device)


def _train(
    learner: Learner,
    network: nn.Module,
    samples: list,
    checks: list,
    training: TrainingSettings,
    phase: str,
    inputs: list[File],
    *,
    seed: int,
    code: str,
    out: File,
    history: File,
) -> None:
    """Train, write the network, then drop the checkpoint, so that a kill at any time costs little."""
    checkpoint = Path(out).with_suffix(".resume.pt")

    def validate() -> float:
        return learner.error(network, checks).item()

    logging.info("%s: %d samples, %d held back", phase, len(samples), len(checks))
    train(
        network,
        lambda step: learner.terms(network, [samples[index] for index in step.samples], step),
        len(samples),
        training,
        phase=phase,
        seed=seed,
        code=code,
        checkpoint=checkpoint,
        history=history,
        validate=validate if checks else None,
        inputs=inputs,
    )
    plain = asdict(training) | {"weights": dict(training.weights)}
    save_network(out, network, learner.network, training=plain, seed=seed)
    checkpoint.unlink(missing_ok=True)
