"""The loop: which weights it keeps, when it stops, how it weighs physics, what it says while it runs."""

import contextlib
import csv
import logging
import math

import numpy as np
import pytest
import torch

from pinnochio.training import progress
from pinnochio.training.loop import train
from pinnochio.training.progress import TrainingProgress, readable
from pinnochio.training.validation import held_back
from tests.helpers.settings import training_settings


class Scalar(torch.nn.Module):
    """One weight, which starts at 0 and which :func:`towards_one` pulls to 1."""

    def __init__(self):
        super().__init__()
        self.w = torch.nn.Parameter(torch.zeros(()))


def towards_one(network, physics=None, seen=None):
    """Terms of a loss whose data term is least at w = 1."""

    def terms(step):
        if seen is not None:
            seen.append(step)
        loss_terms = {"data": (network.w - 1) ** 2, "boundary": 0 * network.w}
        if step.physics and physics:
            loss_terms["physics"] = physics(step) + 0 * network.w
        return loss_terms

    return terms


def fit(tmp_path, steps, network=None, terms=None, validate=None, **options):
    """Rows of the history of a run and its network."""
    network = network or Scalar()
    options = {"weights": {"physics": 0.0, "data": 1.0, "boundary": 1.0}, "mirror": False} | options
    settings = training_settings(steps, options.pop("learning_rate", 0.05), **options)
    paths = {"checkpoint": tmp_path / "c.pt", "history": tmp_path / "h.csv"}
    train(
        network, terms or towards_one(network), 1, settings, phase="x", seed=0, code="code", validate=validate, **paths
    )
    with open(paths["history"], newline="") as file:
        return [{name: float(text) for name, text in row.items()} for row in csv.DictReader(file)], network


def test_best_weights_are_kept_and_the_history_says_where(tmp_path):
    """The patient held back wants w = 0.3, which the training passes on its way to 1."""
    network = Scalar()
    rows, _ = fit(tmp_path, 60, network, validate=lambda: abs(network.w.item() - 0.3), validate_every=2)
    looked = {row["step"]: row["validation"] for row in rows if not math.isnan(row["validation"])}
    assert list(looked) == list(range(0, 61, 2))
    assert looked[60] > 0.5 and min(looked.values()) < 0.04
    assert abs(network.w.item() - 0.3) == pytest.approx(min(looked.values()), abs=1e-6)
    assert [row["step"] for row in rows if row["kept"]] == [min(looked, key=looked.get)]
    # The row of a step holds loss and error of the same weights.
    for row in rows[:-1]:
        if row["step"] in looked:
            either = [1 - math.sqrt(row["data"]), 1 + math.sqrt(row["data"])]
            assert min(abs(abs(w - 0.3) - row["validation"]) for w in either) < 1e-4


def test_without_validation_the_last_weights_are_taken(tmp_path):
    rows, network = fit(tmp_path, 60)
    assert len(rows) == 60 and not any(row["kept"] for row in rows)
    assert network.w.item() > 0.9


def test_start_is_kept_if_training_only_does_harm(tmp_path):
    network = Scalar()
    rows, _ = fit(tmp_path, 20, network, validate=lambda: abs(network.w.item()), validate_every=5)
    assert network.w.item() == 0 and rows[0]["kept"] == 1 and rows[-1]["step"] == 20


def test_resumed_run_keeps_the_best_weights_of_before_and_counts_on(tmp_path):
    """The best look is in about step 8, the break in step 31."""
    runs = {}
    options = {"validate_every": 2, "checkpoint_every": 10}
    for name, breaks in (("unbroken", 0), ("resumed", 1)):
        (tmp_path / name).mkdir()
        for attempt in range(breaks + 1):
            network, seen = Scalar(), []
            plain = towards_one(network, seen=seen)

            def terms(step, plain=plain, seen=seen, dies=attempt < breaks):
                if dies and len(seen) == 31:
                    raise KeyboardInterrupt
                return plain(step)

            look = {"validate": lambda network=network: abs(network.w.item() - 0.3)}
            with contextlib.suppress(KeyboardInterrupt):
                runs[name] = fit(tmp_path / name, 100, network, terms, **look, **options), len(seen)
    (rows, network), (again, other) = runs["unbroken"][0], runs["resumed"][0]
    kept = next(row["step"] for row in rows if row["kept"])
    assert kept < 30 and rows[-1]["step"] == 100
    table, same = ([list(row.values()) for row in history] for history in (rows, again))
    assert np.array_equal(table, same, equal_nan=True)
    assert network.w.item() == other.w.item() and runs["resumed"][1] == len(rows) - 1 - 30


def test_weights_reached_without_the_full_physics_do_not_count(tmp_path):
    """Best at the start by the error, but the ramp goes on to step 20."""
    network = Scalar()
    options = {"weights": {"physics": 1.0, "data": 1.0, "boundary": 1.0}, "validate_every": 5}
    terms = towards_one(network, lambda step: torch.ones(()))
    rows, _ = fit(tmp_path, 40, network, terms, lambda: abs(network.w.item()), physics_ramp=0.5, **options)
    assert [row["step"] for row in rows if row["kept"]] == [20]
    assert [row["physics_weight"] for row in rows[:21:5]] == pytest.approx([0.05, 0.3, 0.55, 0.8, 1.0])


def test_loss_that_stays_infinite_gives_up_and_leaves_the_weights(tmp_path, caplog):
    network = Scalar()

    def terms(step):
        return {"data": network.w * float("inf"), "boundary": 0 * network.w}

    with pytest.raises(RuntimeError, match="not finite 20 steps in a row"):
        fit(tmp_path, 100, network, terms)
    assert network.w.item() == 0 and sum("skipped" in line for line in caplog.messages) == 20


def test_checkpoints_by_time_too(tmp_path, monkeypatch):
    steps = []
    monkeypatch.setattr("pinnochio.training.loop.save_state", lambda path, state: steps.append(state["step"]))
    fit(tmp_path, 10, checkpoint_every=4, checkpoint_seconds=1e9)
    assert steps == [4, 8]
    steps.clear()
    fit(tmp_path, 4, checkpoint_every=1000, checkpoint_seconds=0.0)
    assert steps == [1, 2, 3]


def test_log_has_a_line_every_interval_with_medians_rate_and_time_left(caplog):
    now = [0.0]
    lines = TrainingProgress("pretrain", 100, 200, clock=lambda: now[0])
    with caplog.at_level(logging.INFO):
        for step in range(100, 200):
            now[0] += 1.0
            lines.update(
                step + 1, {"data": float(step), "physics": 1e9 if step == 105 else 3.0}, 2e-3, "validation 0.5"
            )
    interval = int(progress.INTERVAL)
    assert len(caplog.messages) == 100 // interval + 1
    left = readable(100 - interval)
    expected = (
        f"pretrain: step {100 + interval} of 200, data 107, physics 3, learning rate 0.002, 1 steps/s, {left} left"
    )
    assert caplog.messages[0] == f"{expected}, validation 0.5"
    assert caplog.messages[-1].startswith("pretrain: step 200 of 200") and "0 s left" in caplog.messages[-1]
    assert not any("\r" in line or "\n" in line for line in caplog.messages)


def test_training_logs_losses(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(progress, "INTERVAL", 0.0)
    network = Scalar()
    with caplog.at_level(logging.INFO):
        fit(tmp_path, 3, network, validate=lambda: 1.0, validate_every=2)
    assert caplog.messages[0].startswith("x: step 1 of 3, data 1, boundary 0, learning rate 0.0")
    assert caplog.messages[0].endswith("validation 1 (least 1 at step 0)") and len(caplog.messages) == 4


def test_held_back_patients_are_drawn_from_the_cases_and_never_more_than_a_quarter():
    cases = [f"V{number:02d}" for number in range(32)]
    assert held_back(cases, 0) == [False] * 32 and sum(held_back(cases, 1)) == 1 and sum(held_back(cases, 100)) == 8
    assert held_back(cases, 2) == held_back(cases, 2)
    assert not any(held_back(cases[:3], 1)) and sum(held_back(cases[:4], 1)) == 1
    folds = {tuple(held_back(cases[:part] + cases[part + 8 :], 1)) for part in range(0, 32, 8)}
    assert len(folds) > 1  # another fold, another patient
