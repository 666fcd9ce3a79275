"""Tense skin of a face: of the right size, nothing with the switch off."""

import numpy as np
import pytest

from pinnochio.model.patient import PatientModel
from pinnochio.virtual.loading import AT_MOUTH, IN_CHEEK, SKIN, loads, skin_tension
from tests.helpers.heads import kuhn_cube

MARKS = {
    "cheilion_left": np.array([25.0, 0, 0]),
    "cheilion_right": np.array([0.0, 0, 0]),
    "labrale_inferius": np.array([12.0, 0, 3]),
    "nasion": np.array([0.0, -1000, 0]),  # a nose far away
    "pronasale": np.array([0.0, -1010, -10]),
    "subnasale": np.array([0.0, -1000, -20]),
}


@pytest.fixture(scope="module")
def patient():
    """A cube of 100 mm whose front (y = 0) is skin, with a mouth at one edge."""
    mesh = kuhn_cube(8)
    points = 100 * mesh.points
    faces = mesh.boundary_faces()[0]
    front = faces[(points[faces][:, :, 1] == 0).all(axis=1)]
    zeros, none = np.zeros(len(points), np.int8), np.zeros((0, 3))
    return PatientModel(
        points, mesh.cells, mesh.tissue, zeros, zeros - 1, zeros, np.zeros_like(points), zeros, front,
        np.ones(len(front), bool), none, none, none.astype(int), np.zeros(0, int), ("jaw",),
        skin_points=points[np.unique(front)], skin_nodes=np.repeat(np.unique(front)[:, None], 3, 1),
        skin_weights=np.tile([1.0, 0, 0], (len(np.unique(front)), 1)),
    )  # fmt: skip


def test_the_skin_is_tense_in_the_cheek_and_slack_at_the_mouth(patient):
    faces, tension = skin_tension(patient, MARKS)
    assert (patient.points[faces][:, :, 1] == 0).all() and len(faces) == len(patient.skin_faces)
    away = np.linalg.norm(patient.points[faces].mean(axis=1) - [12, 0, 0], axis=1)
    assert tension[away < 12] == pytest.approx(SKIN * AT_MOUTH, abs=3)
    assert tension[away > 100] == pytest.approx(SKIN * IN_CHEEK, rel=0.01)


def test_the_tension_is_a_multiple_of_the_mean_and_varies_over_patients(patient):
    _, published = skin_tension(patient, MARKS)
    assert loads(patient, MARKS, 0.0, None) is None
    mean = loads(patient, MARKS, 1.0, None)
    assert np.array_equal(mean.tension, published) and not mean.forces.any()
    tension = [loads(patient, MARKS, 2.0, np.random.default_rng(seed)).tension.mean() for seed in range(400)]
    assert np.mean(tension) == pytest.approx(2 * published.mean(), rel=0.05)
    assert np.std(tension) / np.mean(tension) == pytest.approx(0.25, rel=0.15)
