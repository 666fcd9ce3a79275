"""Two phases of training on tiny patients, as a whole or stopped at a step."""

import signal
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import torch

from pinnochio.mechanics.materials import neo_hookean
from pinnochio.methods.pinnochio.learner import CaseFiles, finetune_fold, pretrain_fold
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.settings import NetworkSettings
from pinnochio.training import loop
from pinnochio.training.settings import TrainingSettings
from tests.helpers.patients import tiny_patient, tiny_plan

SMALL = NetworkSettings(boundary_layers=1, volume_layers=1, rest_layers=1, channels=8, heads=2, decoder_width=8)
# One patient of four held back, everything on that a checkpoint has to carry.
TRAINING = TrainingSettings(
    24, 3e-3, physics_ramp=0.2, physics_target=0.5, validation=1, validate_every=4, checkpoint_every=5
)
PHASES = {"pretrain": ("pretrained.pt", "pretraining.csv"), "finetune": ("network.pt", "finetuning.csv")}


@dataclass(frozen=True)
class Mechanics:
    volumetric: str = "patch"

    def material(self, tissue):
        return neo_hookean(tissue, {MUSCLE: 6.0, SUPERFICIAL: 4.0}, 0.49, 0)


def make_cases(folder: Path, count: int = 4) -> list[CaseFiles]:
    """Files of tiny patients: the whole block follows the bone, more or less, and the skin swells by 1 mm."""
    found = []
    for seed in range(count):
        model, plan = tiny_patient(seed, (5, 4, 3)), replace(tiny_plan(x=float(seed)), case=f"tiny{seed}")
        paths = {name: folder / f"{name}_{seed}" for name in ("model", "fem_samples", "plan", "postop")}
        model.write(paths["model"])
        plan.write(paths["plan"])
        field = plan.motion("left").displacement(model.points) * (0.8, 0.9, 1.0)
        with h5py.File(paths["fem_samples"], "w") as file:
            file["plan_0/displacement"] = field
            file["plan_0"].attrs["plan"] = plan.to_json()
        PostopSkin(model.points + field + [0, 0, 1], model.skin_faces, 0.0).write(paths["postop"])
        found.append(CaseFiles(plan.case, **paths))
    return found


def run(phase: str, cases: list[CaseFiles], folder: Path, training: TrainingSettings = TRAINING) -> None:
    """Do a phase in `folder`; fine-tuning starts from the network that is there."""
    out, history = (folder / name for name in PHASES[phase])
    options = {"seed": 3, "device": "cpu", "out": out, "history": history}
    if phase == "pretrain":
        pretrain_fold(cases, SMALL, training, Mechanics(), **options)
    else:
        finetune_fold(cases, folder / PHASES["pretrain"][0], training, Mechanics(), **options)


def run_and_hang(phase: str, inputs: str, folder: str, threads: str, at: str) -> None:
    """What the child process does: a phase that goes to sleep for good in the step number `at`."""
    torch.set_num_threads(int(threads))
    sample_at = loop.sample_at

    def hanging(step, *rest):
        while step == int(at):
            signal.pause()
        return sample_at(step, *rest)

    loop.sample_at = hanging
    run(phase, make_cases(Path(inputs)), Path(folder))
