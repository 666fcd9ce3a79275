"""Sources: loads on the soft tissue, whose answers are equilibria under just these loads."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics import load_sources
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.load_sources import AnsweringTissue
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import FREE, SLIDING
from pinnochio.plans.plan import Plan
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings


class Slab:
    """In place of the modes of a face, which a slab has not: three smooth patterns of its skin."""

    def __init__(self, patient):
        face = patient.skin_points[patient.judged_points]
        x, y = np.linalg.svd(face - face.mean(axis=0), full_matrices=False)[2][:2] @ (face - face.mean(axis=0)).T / 30
        parts = np.cos(np.pi * x / 2) * np.cos(np.pi * y / 2), np.sin(np.pi * x), np.sin(np.pi * y)
        self.patterns = np.stack(parts, axis=1)

    def __call__(self, _):
        return self.patterns

    def halves(self, patterns):
        return patterns[:, :1], patterns[:, 1:]


@pytest.fixture
def made(monkeypatch):
    """A slab of 60 x 60 x 15 mm, its law, its patterns and its tissue."""
    patient, fem = tiny_patient(shape=(13, 13, 4)), fem_settings()
    slab = Slab(patient)
    monkeypatch.setattr(load_sources.FaceModes, "of", lambda models: slab)
    return patient, fem.material(patient.tissue), slab.patterns, AnsweringTissue(patient, fem)


def test_a_small_load_does_what_newton_says(made):
    patient, law, patterns, tissue = made
    wanted = 1e-4 * np.random.default_rng(0).normal(size=(len(patterns), 3))
    forces, field = tissue.answer(wanted)
    boundary = boundary_conditions(patient, Plan("P", {}), "mucosa")
    settings = fem_settings(tolerance=1e-10)
    exact = solve(patient.points, patient.cells, law, replace(boundary, loads=Loads(forces)), settings)
    assert exact.converged
    np.testing.assert_allclose(field, exact.displacement, rtol=0, atol=1e-3 * np.abs(exact.displacement).max())
    assert not field[~np.isin(patient.node_type, (FREE, SLIDING))].any()
    assert np.abs(field[patient.node_type == SLIDING]).max() > 1e-6


def test_the_skin_goes_where_it_is_wanted(made):
    """Outwards by a pattern, and along itself, as nearly as tissue does that bone holds on both sides."""
    patient, _, patterns, tissue = made
    face = patient.judged_points
    normals = vertex_normals(patient.skin_points, patient.skin_faces)[face]
    along = np.cross(normals, [1.0, 0.2, 0.1])
    for way in (normals, along):
        for pattern in patterns.T:
            wanted = pattern[:, None] * way
            _, field = tissue.answer(wanted)
            moved = (patient.moved_skin(field) - patient.skin_points)[face]
            assert np.corrcoef(moved.ravel(), wanted.ravel())[0, 1] > 0.7  # three patterns on a slab


@pytest.mark.parametrize("turns", [1, 5, 40])
def test_what_the_tissue_cannot_do_is_not_forced(made, turns):
    """A finer pattern than any load is left, not brought about by a large load."""
    patient, _, patterns, tissue = made
    face = patient.skin_points[patient.judged_points]
    normals = vertex_normals(patient.skin_points, patient.skin_faces)[patient.judged_points]
    usual, _ = tissue.answer(patterns[:, :1] * normals)
    fine, _ = tissue.answer(np.sin(turns * face[:, :1]) * normals)
    assert np.linalg.norm(fine) < 0.5 / np.sqrt(load_sources.SMOOTH) * np.linalg.norm(usual)


def test_it_follows_a_plan_as_linear_elasticity_does(made):
    patient, _, _, tissue = made
    plan, fem = tiny_plan(x=2.0), fem_settings()
    (solved,) = simulate(patient, [plan], fem, linear=True)
    moved = (patient.moved_skin(solved.displacement) - patient.skin_points)[patient.judged_points]
    assert np.abs(moved).max() > 0.1
    np.testing.assert_allclose(tissue.follows(plan), moved, atol=1e-6)
