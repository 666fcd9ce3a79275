"""The rule of convergence, on curves whose fall is known."""

import csv
import math

import pytest

from pinnochio.training.convergence import convergence
from pinnochio.training.loop import COLUMNS


def history(path, data, looks=None, every=10):
    """Write a history of the training's data terms, and of looks at patients held back, one after the last step."""
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="nan")
        writer.writeheader()
        for step, value in enumerate(data):
            look = {"validation": looks(step)} if looks and step % every == 0 else {}
            writer.writerow({"step": step, "learning_rate": 1e-3, "data": value} | look)
        if looks:
            writer.writerow({"step": len(data), "validation": looks(len(data))})
    return path


def test_a_curve_that_still_falls_and_one_that_has_ended(tmp_path):
    """Error 1 / (1 + step): at 75 of 100 steps, looked at after 70, 1/71; at the end 1/101."""
    falling = convergence(history(tmp_path / "a.csv", [5.0] * 100, lambda step: 1 / (1 + step)), 0.25)
    assert (falling.done, falling.held_back) == (100, True)
    assert falling.fall == pytest.approx(1 - 71 / 101) and not falling.flat(0.02)
    ended = convergence(history(tmp_path / "b.csv", [5.0] * 100, lambda step: max(0.5, 1 - step / 50)), 0.25)
    assert ended.fall == 0 and ended.flat(0.02)
    slow = convergence(history(tmp_path / "c.csv", [5.0] * 100, lambda step: 1 - 0.03 * (step > 80)), 0.25)
    assert slow.fall == pytest.approx(0.03) and not slow.flat(0.02) and slow.flat(0.04)


def test_a_curve_that_rises_has_not_fallen(tmp_path):
    assert convergence(history(tmp_path / "a.csv", [5.0] * 40, lambda step: 1 + step), 0.25).fall == 0


def test_where_nobody_is_held_back_the_training_itself_is_the_curve(tmp_path):
    """Medians of twentieths: one step of any size says nothing."""
    data = [2.0] * 70 + [1e9] + [2.0] * 9 + [1.0] * 20
    result = convergence(history(tmp_path / "a.csv", data), 0.25)
    assert (result.done, result.held_back) == (100, False) and result.fall == pytest.approx(0.5)
    assert convergence(history(tmp_path / "b.csv", [2.0] * 70 + [1e-9] + [2.0] * 29), 0.25).fall == 0


def test_too_few_steps_say_nothing_and_are_not_flat(tmp_path):
    result = convergence(history(tmp_path / "a.csv", [1.0]), 0.25)
    assert result.done == 1 and math.isnan(result.fall) and not result.flat(1.0)
    none = convergence(history(tmp_path / "b.csv", []), 0.25)
    assert none.done == 0 and not none.flat(1.0)
