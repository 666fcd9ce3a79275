"""What a trained network leaves of its training patients' faces, learned as sources."""

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor, nn

from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.newton_corrections import Finish
from pinnochio.methods import sources
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.methods.pinnochio.predictor import PatientGraphNetwork
from pinnochio.model.postop import PostopSkin
from pinnochio.plans.plan import Plan
from pinnochio.training.case_files import CaseFiles


def learned_sources(
    network: nn.Module,
    patients: Iterable[PatientTensors],
    cases: Sequence[CaseFiles],
    fem: FemSettings,
    corrections: int,
) -> dict[str, Tensor]:
    """The state of :class:`pinnochio.methods.sources.SourceModel`, over the network's fields after the corrections.

    Tensors of one patient at a time are held.
    """
    models, bases = [], []
    for patient, files in zip(patients, cases, strict=True):
        finish = Finish(patient.model, fem, corrections)
        bases.append(finish(*PatientGraphNetwork(network, patient)(Plan.read(files.plan, files.case)))[0])
        models.append(patient.model)
    learned = sources.fit(models, bases, [PostopSkin.read(files.postop).surface for files in cases])
    return {name: torch.as_tensor(value) for name, value in learned.state().items()}
