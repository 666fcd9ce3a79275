"""Sources: loads on the soft tissue, whose answers are equilibria under just these loads."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.load_sources import SMOOTH, AnsweringTissue, units
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import FREE, SLIDING
from pinnochio.plans.plan import Plan
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import fem_settings


@pytest.fixture(scope="module")
def made():
    """A slab of 60 x 60 x 15 mm, its law, three smooth patterns of its skin and the sources for them."""
    patient = tiny_patient(shape=(13, 13, 4))
    fem = fem_settings()
    face = patient.skin_points[patient.judged_points]
    x, y = np.linalg.svd(face - face.mean(axis=0), full_matrices=False)[2][:2] @ (face - face.mean(axis=0)).T / 30
    patterns = np.stack([np.cos(np.pi * x / 2) * np.cos(np.pi * y / 2), np.sin(np.pi * x), np.sin(np.pi * y)], axis=1)
    return patient, fem.material(patient.tissue), patterns, AnsweringTissue(patient, fem)(patterns)


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


def test_a_unit_moves_the_skin_outwards_by_its_pattern(made):
    """As nearly as tissue does that bone holds on both sides; outward says by how much."""
    patient, _, patterns, sources = made
    face = patient.judged_points
    normals = vertex_normals(patient.skin_points, patient.skin_faces)[face]
    moved = np.stack([patient.moved_skin(field) - patient.skin_points for field in map(sources.field, np.eye(3))])[
        :, face
    ]
    outward = np.einsum("qkx,kx->kq", moved, normals)
    np.testing.assert_allclose(outward, sources.outward, atol=1e-9)
    for number in range(3):
        assert np.corrcoef(outward[:, number], patterns[:, number])[0, 1] > 0.85


@pytest.mark.parametrize("least", [0.0, 1e-3, 0.03, -0.03])
def test_loads_are_bounded_however_little_the_tissue_answers(least):
    """A pattern that hardly any load brings about is left, not brought up by a large load: at most 0.5 / sqrt(SMOOTH)
    times a usual one."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 9)))[0]
    outward, area = turn @ np.diag([1.0] * 8 + [least]) @ turn.T, np.full(9, 1 / 9)
    loads = units(outward, turn, area)
    assert np.linalg.norm(loads, axis=0).max() < 1.1 * 0.5 / np.sqrt(SMOOTH)
    np.testing.assert_allclose((outward @ loads)[:, :8], turn[:, :8], atol=0.02)
