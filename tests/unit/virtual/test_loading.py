"""Weight and tense skin of a face: of the right size, more with body mass, nothing with the switches off."""

import numpy as np
import pytest

from pinnochio.mechanics.elements.tetrahedra import node_volumes
from pinnochio.model.patient import PatientModel
from pinnochio.virtual.covariates import Covariates
from pinnochio.virtual.loading import AT_MOUTH, IN_CHEEK, SKIN, WEIGHT, loads, sag, skin_tension, weight_change
from tests.helpers.heads import kuhn_cube

USUAL = Covariates("female", 25.0, 23.5, 6.0, "simple", False)
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


def test_the_weight_turns_from_the_back_of_the_head_to_the_feet(patient):
    forces = weight_change(patient, MARKS, 1.0)
    assert forces.sum(axis=0) == pytest.approx([0, -WEIGHT * 1e6, -WEIGHT * 1e6])
    assert np.allclose(forces[:, 1], -WEIGHT * node_volumes(patient.points, patient.cells))


def test_the_nose_hangs_on_cartilage(patient):
    corners = np.array([[50.0, 0, 60], [50, -10, 50], [50, 0, 40]])
    nose = dict(zip(("nasion", "pronasale", "subnasale"), corners, strict=True))
    free, carried = (weight_change(patient, MARKS | marks, 1.0) for marks in ({}, nose))
    at, far = (np.argmin(np.linalg.norm(patient.points - place, axis=1)) for place in ([50, 0, 50], [100, 100, 0]))
    assert np.allclose(carried[at], 0) and np.allclose(carried[far], free[far])


def test_more_body_mass_and_age_sag_more():
    heavy, old = Covariates("male", 25.0, 30.5, 6.0, "vy", True), Covariates("male", 45.0, 23.5, 6.0, "vy", True)
    assert sag(USUAL) == 1 and sag(heavy) == pytest.approx(1.5) and sag(old) == pytest.approx(1.2)
    assert sag(Covariates("male", 25.0, 12.0, 6.0, "vy", True)) == 0.3


def test_the_skin_is_tense_in_the_cheek_and_slack_at_the_mouth(patient):
    faces, tension = skin_tension(patient, MARKS)
    assert (patient.points[faces][:, :, 1] == 0).all() and len(faces) == len(patient.skin_faces)
    away = np.linalg.norm(patient.points[faces].mean(axis=1) - [12, 0, 0], axis=1)
    assert tension[away < 12] == pytest.approx(SKIN * AT_MOUTH, abs=3)
    assert tension[away > 100] == pytest.approx(SKIN * IN_CHEEK, rel=0.01)


def test_switches_change_only_themselves(patient):
    def drawn(posture, pre_stress, seed=0):
        return loads(patient, MARKS, USUAL, posture, pre_stress, np.random.default_rng(seed))

    assert drawn(0, 0) is None
    both, heavy, tense = drawn(1, 1), drawn(1, 0), drawn(0, 1)
    assert np.array_equal(both.forces, heavy.forces) and not len(heavy.faces) and not tense.forces.any()
    assert np.array_equal(both.tension, tense.tension) and np.allclose(drawn(0, 2).tension, 2 * tense.tension)
    means = [drawn(0, 1, seed).tension.mean() for seed in range(400)]
    assert np.std(means) / np.mean(means) == pytest.approx(0.25, rel=0.15)
