"""Training of a fold's network in two phases: pretraining on finite-element samples, fine-tuning on outcomes."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from pinnochio.seeds import derive_seed
from pinnochio.training.case_files import CaseFiles, File
from pinnochio.training.checkpoint import read_network, save_network
from pinnochio.training.loop import Step, train
from pinnochio.training.recording import Piece, RecordedGradients
from pinnochio.training.settings import TrainingSettings
from pinnochio.training.streaming import StreamedSamples
from pinnochio.training.validation import held_back


class Learner(Protocol):
    """A method that trains by steps, in one phase: made of its settings (values by section), the phase and the device.

    recorded: whether its steps run by recorded kernels (:mod:`pinnochio.training.recording`).
    network: plain values, a dataclass that is stored with the network; build(network): the network, freshly initialised
    from torch's random state. A sample is what one step shows of one patient and plan; its kind is the learner's own.
    """

    device: str
    recorded: bool
    network: Any
    training: TrainingSettings
    build: Callable[[Any], nn.Module]

    def piece(self, network: nn.Module, sample: Any, step: Step) -> Piece:
        """The loss of a sample, where `recorded` says that its steps can be."""

    def read(self, files: CaseFiles) -> list:
        """A sample for each of the patient's finite-element samples, or one of its own plan and post-operative skin;
        InputError where the files do not fit each other."""

    def terms(self, network: nn.Module, samples: Sequence, step: Step) -> Mapping[str, Tensor]:
        """Loss terms of the samples of a step, see :func:`~pinnochio.training.loop.train`."""

    def error(self, network: nn.Module, samples: Sequence) -> Tensor:
        """Mean error of the network on samples that are not trained on; the same at every call."""

    def completed(self, network: nn.Module, cases: Sequence[CaseFiles]) -> Mapping[str, Mapping[str, Tensor]]:
        """What is learned at once when the network is trained, by the name under which it is stored with it."""


def train_fold(
    learner: Learner,
    phase: str,
    cases: Sequence[CaseFiles],
    pretrained: File | None = None,
    *,
    seed: int,
    code: str,
    out: File,
    history: File,
) -> None:
    """Train the network at `pretrained`, or a new one, on the cases; write it to `out` and the losses to `history`.

    phase: one of PHASES; code: hash of the code that trains. The checkpoint goes when the network is there, so that a
    kill at any time costs little.
    """
    training, checkpoint = learner.training, Path(out).with_suffix(".resume.pt")
    checked = held_back([files.case for files in cases], training.validation)
    shown = [files for files, aside in zip(cases, checked, strict=True) if not aside]
    checks = [sample for files, aside in zip(cases, checked, strict=True) if aside for sample in learner.read(files)]
    streams = len(shown) > training.patients_in_memory
    if streams:
        samples = StreamedSamples(learner.read, shown, training.patients_in_memory)
    else:
        samples = [sample for files in shown for sample in learner.read(files)]
    if pretrained is None:
        torch.manual_seed(derive_seed(seed, phase, "weights"))
        network = learner.build(learner.network).to(learner.device)
    else:
        network, _ = read_network(pretrained, type(learner.network), learner.build, learner.device)
    logging.info("%s: %d samples, %d held back", phase, len(samples), len(checks))
    gradients = None
    if learner.recorded and not streams:  # a recording holds on to its patient
        gradients = RecordedGradients(network, lambda index, step: learner.piece(network, samples[index], step))
    train(
        network,
        lambda step: learner.terms(network, [samples[index] for index in step.samples], step),
        len(samples),
        training,
        order=samples.order if streams else None,
        phase=phase,
        seed=seed,
        code=code,
        checkpoint=checkpoint,
        history=history,
        validate=(lambda: learner.error(network, checks).item()) if checks else None,
        inputs=[path for files in cases for path in files.inputs],
        gradients=gradients,
    )
    plain = asdict(training) | {"weights": dict(training.weights)}
    save_network(out, network, learner.network, training=plain, seed=seed, **learner.completed(network, cases))
    checkpoint.unlink(missing_ok=True)
