"""Sources: loads on the soft tissue, whose answers are equilibria under just these loads."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.elements.tetrahedra import node_volumes
from pinnochio.mechanics.load_sources import DAMPING, WEIGHT, make_sources, units
from pinnochio.mechanics.problems import uniform
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import FREE, SLIDING
from pinnochio.plans.plan import Plan
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import fem_settings


@pytest.fixture(scope="module")
def made():
    """A slab of 60 x 60 x 15 mm, its law, nine anchors of its skin and the sources there."""
    patient = tiny_patient(shape=(13, 13, 4))
    law = uniform(len(patient.cells))
    skin = np.unique(patient.skin_faces)
    places = np.array([(a, b) for a in (25, 40, 55) for b in (-65, -50, -35)])
    apart = np.linalg.norm(patient.skin_points[skin, None, :2] - places, axis=2)
    anchors = skin[apart.argmin(0)]
    return patient, law, anchors, make_sources(patient, law, anchors)


def test_a_small_load_does_what_newton_says(made):
    patient, law, _, sources = made
    amplitudes = 1e-4 * np.random.default_rng(0).normal(size=len(sources.forces))
    boundary = boundary_conditions(patient, Plan("P", {}), "mucosa")
    loads = Loads(sources.load(amplitudes))
    exact = solve(patient.points, patient.cells, law, replace(boundary, loads=loads), fem_settings(tolerance=1e-10))
    assert exact.converged
    size = np.abs(exact.displacement).max()
    np.testing.assert_allclose(sources.field(amplitudes), exact.displacement, rtol=0, atol=1e-3 * size)
    held = ~np.isin(patient.node_type, (FREE, SLIDING))
    assert not sources.fields[:, held].any() and np.abs(sources.fields[:, patient.node_type == SLIDING]).max() > 1e-3


def test_a_unit_moves_the_skin_outwards_at_its_anchor(made):
    patient, _, anchors, sources = made
    normals = vertex_normals(patient.skin_points, patient.skin_faces)[anchors]
    moved = np.stack([patient.moved_skin(field) - patient.skin_points for field in sources.fields])[:-1, anchors]
    outward = np.einsum("qax,ax->qa", moved, normals)
    assert np.abs(outward - np.eye(len(anchors))).max() < 0.1


@pytest.mark.parametrize("least", [0.0, 0.01, -DAMPING, -0.05, -1.0])
def test_a_unit_is_no_more_than_one_however_little_an_anchor_answers(least):
    """Directions that hardly answer, or the wrong way: none is brought up by a large load."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 9)))[0]
    outward = turn @ np.diag([1.0] * 8 + [least]) @ turn.T
    moved = units(outward) @ outward
    assert np.linalg.norm(moved, 2) <= 1 + 1e-9
    np.testing.assert_allclose(moved @ turn[:, 0], turn[:, 0], atol=0.05)


def test_sitting_up_turns_the_whole_weight(made):
    patient, _, _, sources = made
    weight = WEIGHT * node_volumes(patient.points, patient.cells).sum()
    np.testing.assert_allclose(sources.forces[-1].sum(0), [0, -weight, -weight], atol=1e-9 * weight)
    fallen = patient.moved_skin(sources.fields[-1]) - patient.skin_points
    assert fallen[:, 2].min() < 0 and fallen[:, 1].min() < 0
