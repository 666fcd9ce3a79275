"""Lips, swelling and expression: local, of the asked size, nothing at the bone."""

import numpy as np
import pytest

from pinnochio.virtual.aftermath import LOWER_LIP, UPPER_LIP, WING, expression, lip_change, looseness, swelling
from tests.helpers.heads import dome

MARKS = {
    "labrale_superius": np.array([0.0, -108, -45]),
    "labrale_inferius": np.array([0.0, -105, -60]),
    "subnasale": np.array([0.0, -104, -27]),
    "cheilion_left": np.array([25.0, -95, -52]),
    "cheilion_right": np.array([-25.0, -95, -52]),
    "tragus_left": np.array([70.0, 0, 0]),
    "tragus_right": np.array([-70.0, 0, 0]),
}


def test_lip_change_is_local_and_of_the_asked_size():
    wing = MARKS["subnasale"] + [0.34 * 50, 4, 4]
    points = np.array([MARKS["labrale_superius"], MARKS["labrale_inferius"], wing, [0, -95, 30.0], wing * [-1, 1, 1]])
    change = lip_change(points, MARKS)
    assert change[0, 1] == pytest.approx(UPPER_LIP, abs=0.25)  # back
    assert change[1, 1] == pytest.approx(0.5 * LOWER_LIP, abs=0.25) and change[1, 2] > 0.2
    assert change[2, 0] == pytest.approx(WING, abs=0.15) and change[4, 0] == pytest.approx(-change[2, 0])
    assert np.linalg.norm(change[3]) < 1e-6


def test_tissue_is_constrained_at_the_bone():
    bone = np.zeros((1, 3))
    loose = looseness(np.array([[0.0, 0, 0], [5, 0, 0], [10, 0, 0], [40, 0, 0]]), bone)
    assert np.allclose(loose, [0, 0.5, 1, 1])


def test_swelling_is_outward_and_has_its_mean():
    points, faces = dome()
    fields = [swelling(points, (points, faces), MARKS, 0.8, np.random.default_rng(seed)) for seed in range(200)]
    assert min(np.sum(field * points, 1).min() for field in fields) >= 0  # outward on a sphere about the origin
    sizes = [np.linalg.norm(field, axis=1).max() for field in fields]  # the larger side
    assert 0.8 < np.mean(sizes) < 1.3 and np.std(sizes) > 0.1
    assert np.linalg.norm(np.mean(fields, 0)[np.argmax(points[:, 2])]) < 0.01  # none on the forehead


def test_expression_moves_both_corners_alike_and_not_the_nose():
    points = np.array([MARKS["cheilion_left"], MARKS["cheilion_right"], MARKS["subnasale"] + [0, 0, 40]])
    draws = np.random.default_rng(0)
    fields = np.array([expression(points, MARKS, 0.8, draws) for _ in range(2000)])
    assert np.linalg.norm(fields[:, :2], axis=2).std(0) == pytest.approx(0.8 * np.sqrt(1 - 2 / np.pi), rel=0.1)
    assert np.corrcoef(fields[:, 0, 2], fields[:, 1, 2])[0, 1] > 0.8
    assert np.allclose(fields[:, 0, 0] * fields[:, 1, 0] < 0, fields[:, 0, 2] * fields[:, 1, 2] > 0)
    assert np.abs(fields[:, 2]).max() < 0.01
