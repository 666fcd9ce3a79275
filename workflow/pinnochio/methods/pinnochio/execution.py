"""What the error of carrying out the plan explains of the training patients' post-operative skins.

About a millimetre of the face is decided by how exactly the surgeon meets the plan. It is chance, so a network that
knows the plan alone cannot predict it; in training it is noise that hides what can be learnt. Where a lift carries
motions of the segments through the tissue, that noise can be separated: per patient, the rigid motions beside the plan
that bring the lift nearest to the skin, kept small by the published error. What all patients share is not an error: the
mean over the fold's training patients is taken off and left to the network, bone by bone over those in whom it moves.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from pinnochio.methods.pinnochio.losses import SurfaceLoss
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.networks.signals import PlanSignal
from pinnochio.plans.roles import known_role
from pinnochio.plans.sampling import EXECUTION
from pinnochio.seeds import generator

STEPS, RATE = 40, 0.1  # of Adam, in published errors; the distance falls by less than 1 % afterwards [X]


def execution_fields(
    samples: Sequence[tuple[PatientTensors, PlanSignal, SurfaceLoss]], prior: float, seed: int
) -> list[Tensor]:
    """Displacement (n, 3) mm of each patient beside that of the plan.

    samples: patients with a lift, their plan and their skin. prior: mm of skin distance that an error of the published
    size (root mean square) costs, per component.
    """
    errors = [_fit(*sample, prior, generator(seed, "execution", str(i))) for i, sample in enumerate(samples)]
    bones = [[_bone(name) for name in sample[0].model.segments] for sample in samples]
    own: dict[str, list[Tensor]] = {}
    for names, error in zip(bones, errors, strict=True):
        for name, row in zip(names, error, strict=True):
            own.setdefault(name, []).append(row)
    common = {name: torch.stack(rows).mean(0) for name, rows in own.items()}
    return [
        motion_field(sample[0], error - torch.stack([common[name] for name in names]))
        for sample, names, error in zip(samples, bones, errors, strict=True)
    ]


def _bone(segment: str) -> str:
    """What a segment shares its systematic error with: all pieces of a maxilla, but each ramus by itself."""
    what = known_role(segment)
    return segment if what in (None, "proximal") else what


def motion_field(patient: PatientTensors, errors: Tensor) -> Tensor:
    """Displacement (n, 3) mm for small motions (K, 6) of the segments about their middles.

    errors: left-right, front-back, vertical, then about these axes, in published errors; a segment without a surface
    is left alone.
    """
    model, amplitudes = patient.model, []
    size = errors.new_tensor(np.sqrt((EXECUTION**2).sum(1)))
    for index, error in enumerate(errors * size):
        own = model.bone_points[model.bone_segment == index]
        shift, turn = error[:3], torch.deg2rad(error[3:])
        x, y, z = turn
        zero = torch.zeros_like(x)
        spin = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero])
        arm = errors.new_tensor(own.mean(0) - patient.lift.centre) if len(own) else torch.zeros_like(shift)
        amplitudes += [spin, shift - torch.linalg.cross(turn, arm)]
    return (torch.cat(amplitudes) @ patient.motions).view_as(patient.points)


def _fit(patient, signal, surface, prior, rng) -> Tensor:
    """Errors (K, 6) that explain the patient's skin best."""
    errors = patient.points.new_zeros(len(patient.model.segments), 6).requires_grad_()
    optimizer = torch.optim.Adam([errors], RATE)
    for step in range(STEPS):
        optimizer.param_groups[0]["lr"] = RATE * (1 - step / STEPS)
        loss = surface(signal.lifted + motion_field(patient, errors), rng) + prior * errors.square().sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return errors.detach()
