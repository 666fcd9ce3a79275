"""A training that is killed and started again ends with the same bytes as an unbroken one."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import pytest
import torch

from pinnochio.training import loop
from pinnochio.training.checkpoint import fingerprint, load_state, save_state
from tests.helpers.training import PHASES, TRAINING, make_cases, run


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


@pytest.mark.parametrize("phase", ["pretrain", pytest.param("finetune", marks=pytest.mark.full)])
def test_killed_and_started_again_gives_the_same_bytes(phase, cases, unbroken, tmp_path, monkeypatch):
    if phase == "finetune":
        (tmp_path / "pretrained.pt").write_bytes((unbroken / "pretrained.pt").read_bytes())
    (tmp_path / "inputs").mkdir()
    code = "import sys; from tests.helpers.training import run_and_hang; run_and_hang(*sys.argv[1:])"
    arguments = [phase, tmp_path / "inputs", tmp_path, str(torch.get_num_threads()), "17"]
    paths = [path for path in sys.path if path]
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
        patch.setattr("pinnochio.training.fold.save_network", die)
        with pytest.raises(KeyboardInterrupt):
            run("pretrain", cases, tmp_path)
    assert steps_of(tmp_path / "pretrained.resume.pt") == 20
    run("pretrain", cases, tmp_path)
    assert (tmp_path / "pretrained.pt").read_bytes() == (unbroken / "pretrained.pt").read_bytes()


def test_checkpoint_of_something_else_is_not_taken_up(cases, tmp_path, monkeypatch):
    sample_at = loop.sample_at

    def first_step(cases=cases, training=TRAINING, code="code"):
        """Step that a run begins with which breaks off in step 7, after a checkpoint at 5."""
        seen = []

        def dying(step, *rest):
            seen.append(step)
            if step == 7:
                raise KeyboardInterrupt
            return sample_at(step, *rest)

        monkeypatch.setattr(loop, "sample_at", dying)
        with pytest.raises(KeyboardInterrupt):
            run("pretrain", cases, tmp_path, training, code)
        return seen[0]

    slower = replace(TRAINING, learning_rate=1e-3)
    assert [first_step(), first_step(), first_step(training=slower), first_step(training=slower)] == [0, 5, 0, 5]
    assert [first_step(training=slower, code="other"), first_step(training=slower, code="other")] == [0, 5]
    other = make_cases(tmp_path)
    with h5py.File(other[0].fem_samples, "a") as file:
        file["plan_0/displacement"][0, 0] += 1e-3
    assert first_step(other, slower) == 0


def test_fingerprint_knows_weights_inputs_and_code(tmp_path):
    torch.manual_seed(0)
    network, file = torch.nn.Linear(2, 2), tmp_path / "input"
    file.write_bytes(b"one")
    first = fingerprint(network, [file], "code")
    assert first == fingerprint(network, [file], "code")
    file.write_bytes(b"two")
    assert first != fingerprint(network, [file], "code")
    file.write_bytes(b"one")
    assert first != fingerprint(network, [file], "other")
    network.weight.data[0, 0] += 1e-3
    assert first != fingerprint(network, [file], "code")


def test_half_written_checkpoint_is_never_read_and_does_not_stay(tmp_path):
    path, rest = tmp_path / "a.resume.pt", tmp_path / ".123.a.resume.pt"
    save_state(path, {"signature": "x", "step": 1})
    rest.write_bytes(b"half")
    assert load_state(path, "x", "cpu")["step"] == 1 and load_state(path, "y", "cpu") is None
    save_state(path, {"signature": "x", "step": 2})
    assert not rest.exists() and load_state(path, "x", "cpu")["step"] == 2
    assert [file.name for file in tmp_path.iterdir()] == ["a.resume.pt"]
