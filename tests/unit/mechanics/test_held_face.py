"""A held face: it comes where it is wanted, and the field is in equilibrium with the load that it declares."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.mechanics import held_face
from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.held_face import HeldFace
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.mechanics.solvers.newton_corrections import EQUILIBRIUM, Finish
from pinnochio.model.patient import FREE, SLIDING
from pinnochio.plans.plan import Plan
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings


@pytest.fixture(scope="module")
def slab():
    """A patient of 60 x 60 x 15 mm, how to solve it, a plan, the field that answers it, and a smooth wish."""
    patient, fem, plan = tiny_patient(shape=(13, 13, 4)), fem_settings(), tiny_plan(x=2.0)
    (base,) = simulate(patient, [plan], fem)
    face = patient.skin_points[patient.judged_points]
    x, y = np.linalg.svd(face - face.mean(axis=0), full_matrices=False)[2][:2] @ (face - face.mean(axis=0)).T
    dome = np.cos(np.pi * x / 60) * np.cos(np.pi * y / 60)  # at the rim the tissue is held
    return patient, fem, plan, base.displacement, dome[:, None] * [0.4, -0.3, 0.8]


def test_it_comes_where_it_is_wanted_and_declares_its_load(slab):
    patient, fem, plan, base, wanted = slab
    held = HeldFace(patient, fem)
    pull = held.pull(wanted, base)
    (solved,) = simulate(patient, [plan], fem, [pull], loads=held.loads)
    assert solved.converged
    moved = patient.onto_judged @ (solved.displacement - base)
    assert np.linalg.norm(moved - wanted) < 0.3 * np.linalg.norm(wanted)
    # The same field answers that load alone, no springs: the residual does not see who pulls.
    dead = Loads(held.force(pull, solved.displacement))
    boundary = replace(boundary_conditions(patient, plan, "mucosa"), loads=dead)
    law = fem.material(patient.tissue)
    again = solve(patient.points, patient.cells, law, boundary, fem, solved.displacement)
    assert again.converged and np.abs(again.displacement - solved.displacement).max() < 1e-3


def test_nothing_wanted_leaves_the_base(slab):
    patient, fem, plan, base, wanted = slab
    held = HeldFace(patient, fem)
    pull = held.pull(0 * wanted, base)
    (solved,) = simulate(patient, [plan], fem, [pull], loads=held.loads)
    assert np.abs(solved.displacement - base).max() < 1e-3
    assert np.abs(held.force(pull, base)).max() < 1e-9


def test_stiffer_springs_bring_it_nearer(slab, monkeypatch):
    patient, fem, plan, base, wanted = slab
    missed = []
    for stiffness in (0.1, 1.0, 10.0, 100.0):
        monkeypatch.setattr(held_face, "STIFFNESS", stiffness)
        held = HeldFace(patient, fem)
        (solved,) = simulate(patient, [plan], fem, [held.pull(wanted, base)], loads=held.loads)
        assert solved.converged and solved.min_jacobian > 0
        missed.append(np.linalg.norm(patient.onto_judged @ (solved.displacement - base) - wanted))
    assert all(after < before for before, after in zip(missed, missed[1:], strict=False))


def test_the_answer_is_the_first_order_of_a_small_wish(slab):
    patient, fem, _, base, wanted = slab
    held, law = HeldFace(patient, fem), fem.material(patient.tissue)
    boundary = boundary_conditions(patient, Plan("P", {}), "mucosa")
    loads = replace(held.loads, forces=held.pull(1e-4 * wanted))
    exact = solve(patient.points, patient.cells, law, replace(boundary, loads=loads), fem_settings(tolerance=1e-10))
    field = held.answer(1e-4 * wanted)
    np.testing.assert_allclose(field, exact.displacement, rtol=0, atol=1e-3 * np.abs(exact.displacement).max())
    assert not field[~np.isin(patient.node_type, (FREE, SLIDING))].any()
    assert np.abs(field[patient.node_type == SLIDING]).max() > 1e-6


def test_corrections_hold_it_too(slab):
    patient, fem, _, base, wanted = slab
    held = HeldFace(patient, fem)
    start, pull = base + held.answer(wanted), held.pull(wanted, base)
    made, _ = Finish(patient, fem, 10, held.loads).all(start, start, pull)
    assert made[-1].residual < EQUILIBRIUM < made[0].residual
    moved = patient.onto_judged @ (made[-1].displacement - base)
    assert np.linalg.norm(moved - wanted) < 0.3 * np.linalg.norm(wanted)
