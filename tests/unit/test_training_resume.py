"""A training that is killed and started again ends with the same bytes as an unbroken one."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import pytest
import torch
from tiny_patient import tiny_patient, tiny_plan

from pinnochio.mechanics.materials import neo_hookean
from pinnochio.methods.pinnochio.learner import CaseFiles, finetune_fold, pretrain_fold
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.model.postop import PostopSkin
from pinnochio.training import loop
from pinnochio.training.checkpoint import fingerprint, load_state, save_state
from pinnochio.training.settings import TrainingSettings
from tests.helpers.settings import network_settings, training_settings

SMALL = network_settings(boundary_layers=1, volume_layers=1, rest_layers=1, channels=8, heads=2, decoder_width=8)
# One patient of four held back, everything on that a checkpoint has to carry.
TRAINING = training_settings(
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


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return make_cases(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def unbroken(cases, tmp_path_factory):
    """Folder of both phases, done without a break."""
    folder = tmp_path_factory.mktemp("unbroken")
    for phase in PHASES:
        run(phase, cases, folder)
    return folder


@pytest.mark.parametrize("phase", PHASES)
def test_killed_and_started_again_gives_the_same_bytes(phase, cases, unbroken, tmp_path, monkeypatch):
    if phase == "finetune":
        (tmp_path / "pretrained.pt").write_bytes((unbroken / "pretrained.pt").read_bytes())
    (tmp_path / "inputs").mkdir()
    code = "import sys, test_training_resume as t; t.run_and_hang(*sys.argv[1:])"
    arguments = [phase, tmp_path / "inputs", tmp_path, str(torch.get_num_threads()), "17"]
    paths = [path for path in sys.path if path] + [str(Path(__file__).parent)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    child = subprocess.Popen([sys.executable, "-c", code, *arguments], env=environment)
    out, history = (tmp_path / name for name in PHASES[phase])
    checkpoint = out.with_suffix(".resume.pt")
    try:
        until = time.monotonic() + 120
        while steps_of(checkpoint) < 15 and child.poll() is None and time.monotonic() < until:
            time.sleep(0.05)
        assert child.poll() is None, "the process ended before it was killed"
        os.kill(child.pid, signal.SIGKILL)
        assert child.wait() == -signal.SIGKILL
    finally:
        child.kill()
        child.wait()
    assert steps_of(checkpoint) == 15 and not out.exists() and not history.exists()
    seen = []
    sample_at = loop.sample_at
    monkeypatch.setattr(loop, "sample_at", lambda step, *rest: seen.append(step) or sample_at(step, *rest))
    run(phase, cases, tmp_path)
    assert seen == list(range(15, 24))
    for name in PHASES[phase]:
        assert (tmp_path / name).read_bytes() == (unbroken / name).read_bytes()
    assert not checkpoint.exists()


def steps_of(checkpoint: Path) -> int:
    """Steps that are in the checkpoint, which another process is writing."""
    return torch.load(checkpoint, weights_only=True)["step"] if checkpoint.exists() else 0


def test_killed_after_the_last_step_costs_the_last_steps_alone(cases, unbroken, tmp_path, monkeypatch):
    """The checkpoint goes only when the network is there."""

    def die(*_args, **_kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("pinnochio.methods.pinnochio.learner.save_network", die)
        with pytest.raises(KeyboardInterrupt):
            run("pretrain", cases, tmp_path)
    assert steps_of(tmp_path / "pretrained.resume.pt") == 20
    run("pretrain", cases, tmp_path)
    assert (tmp_path / "pretrained.pt").read_bytes() == (unbroken / "pretrained.pt").read_bytes()


def test_checkpoint_of_something_else_is_not_taken_up(cases, tmp_path, monkeypatch):
    sample_at = loop.sample_at

    def first_step(cases=cases, training=TRAINING):
        """Step that a run begins with which breaks off in step 7, after a checkpoint at 5."""
        seen = []

        def dying(step, *rest):
            seen.append(step)
            if step == 7:
                raise KeyboardInterrupt
            return sample_at(step, *rest)

        monkeypatch.setattr(loop, "sample_at", dying)
        with pytest.raises(KeyboardInterrupt):
            run("pretrain", cases, tmp_path, training)
        return seen[0]

    slower = replace(TRAINING, learning_rate=1e-3)
    assert [first_step(), first_step(), first_step(training=slower), first_step(training=slower)] == [0, 5, 0, 5]
    other = make_cases(tmp_path)
    with h5py.File(other[0].fem_samples, "a") as file:
        file["plan_0/displacement"][0, 0] += 1e-3
    assert first_step(other, slower) == 0


def test_fingerprint_knows_weights_and_inputs(tmp_path):
    torch.manual_seed(0)
    network, file = torch.nn.Linear(2, 2), tmp_path / "input"
    file.write_bytes(b"one")
    first = fingerprint(network, [file])
    assert first == fingerprint(network, [file])
    file.write_bytes(b"two")
    assert first != fingerprint(network, [file])
    file.write_bytes(b"one")
    network.weight.data[0, 0] += 1e-3
    assert first != fingerprint(network, [file])


def test_half_written_checkpoint_is_never_read_and_does_not_stay(tmp_path):
    path, rest = tmp_path / "a.resume.pt", tmp_path / ".123.a.resume.pt"
    save_state(path, {"signature": "x", "step": 1})
    rest.write_bytes(b"half")
    assert load_state(path, "x", "cpu")["step"] == 1 and load_state(path, "y", "cpu") is None
    save_state(path, {"signature": "x", "step": 2})
    assert not rest.exists() and load_state(path, "x", "cpu")["step"] == 2
    assert [file.name for file in tmp_path.iterdir()] == ["a.resume.pt"]
