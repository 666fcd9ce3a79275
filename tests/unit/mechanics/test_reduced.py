"""A part of the cells solved: those that a plan requires, what holds the others, the field of the whole patient."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.mechanics import simulation
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.contact import ContactSet
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.simulation import Simulator, simulate
from pinnochio.mechanics.solvers import reduced
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.reduced import moved_cells, restricted
from pinnochio.model import patient as m
from pinnochio.plans.plan import Plan
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings

FEM = fem_settings(poisson=0.45)
LIMIT = 1.5  # mm: 59 % of the cells of the long patient


@pytest.fixture(scope="module")
def long():
    """A long patient, whose plan moves one end."""
    return tiny_patient(shape=(16, 5, 4))


def test_cells_are_wanted_for_one_node_that_moves_or_is_kept():
    cells = np.array([[0, 1, 2, 3], [3, 4, 5, 6], [5, 6, 7, 8]])
    field = np.zeros((9, 3))
    field[1] = 0, 0.3, 0.4
    np.testing.assert_array_equal(moved_cells(cells, field, 0.49), [True, False, False])
    np.testing.assert_array_equal(moved_cells(cells, field, 0.5), [False, False, False])
    np.testing.assert_array_equal(moved_cells(cells, field, 0.49, [8]), [True, False, True])


def test_the_cut_moves_with_the_linear_field_and_the_rest_is_as_it_was(long):
    whole = boundary_conditions(long, tiny_plan(), "mucosa")
    field = np.random.default_rng(0).normal(size=long.points.shape)
    wanted = long.points[long.cells].mean(axis=1)[:, 0] < 40
    nodes, cells, part = restricted(whole, long.cells, wanted, field)
    np.testing.assert_array_equal(nodes[cells], long.cells[wanted])
    kept, held = np.unique(long.cells[wanted]), np.unique(long.cells[~wanted])
    np.testing.assert_array_equal(nodes, kept)
    before = np.isin(whole.prescribed_nodes, kept)
    count = before.sum()
    np.testing.assert_array_equal(nodes[part.prescribed_nodes[:count]], whole.prescribed_nodes[before])
    cut = nodes[part.prescribed_nodes[count:]]
    np.testing.assert_array_equal(cut, np.setdiff1d(np.intersect1d(kept, held), whole.prescribed_nodes))
    for fraction in (0.5, 1.0):
        moved = part.displacement(fraction)
        np.testing.assert_array_equal(moved[:count], whole.displacement(fraction)[before])
        np.testing.assert_allclose(moved[count:], fraction * field[cut])
    assert sum(len(item.nodes) for item in part.sliding) < sum(len(item.nodes) for item in whole.sliding)
    for one, two in zip(part.sliding, whole.sliding, strict=True):
        np.testing.assert_array_equal(nodes[one.nodes], np.setdiff1d(two.nodes, held))


def test_a_linear_part_is_the_whole_linear_field(long):
    """Superposition: with the linear field on the cut, linear elasticity of a part gives that field again."""
    whole = boundary_conditions(long, tiny_plan(), "mucosa")
    solver = ElasticSolver(long.points, long.cells, FEM.material(long.tissue), whole, "p1")
    field = solver.solve(whole)
    wanted = moved_cells(long.cells, field, LIMIT)
    assert 0.1 < wanted.mean() < 0.9
    nodes, cells, boundary = restricted(whole, long.cells, wanted, field)
    part = ElasticSolver(long.points[nodes], cells, FEM.material(long.tissue[wanted]), boundary, "p1")
    np.testing.assert_allclose(part.solve(boundary), field[nodes], atol=1e-10)


def test_contact_surfaces_beyond_the_cut_are_carried():
    cells = np.array([[0, 1, 2, 3], [3, 4, 5, 6], [6, 7, 8, 9]])
    sides = [ContactSet(np.array([1, 2]), np.ones(2), faces=np.array([[2, 3, 9]]))]
    whole = BoundaryConditions(np.array([0, 8]), np.arange(6.0).reshape(2, 3), contact=sides)
    field = np.arange(30.0).reshape(10, 3)
    nodes, _, part = restricted(whole, cells, np.array([True, False, False]), field)
    np.testing.assert_array_equal(nodes, [0, 1, 2, 3, 9])
    np.testing.assert_array_equal(part.contact[0].faces, [[2, 3, 4]])
    np.testing.assert_array_equal(nodes[part.prescribed_nodes], [0, 3, 9])
    np.testing.assert_array_equal(part.displacement(1.0), [[0, 1, 2], *field[[3, 9]]])


@pytest.mark.parametrize(("arm", "kept"), [("mucosa", True), ("mucosa", False), ("bonded", True)])
def test_a_reduced_plan_is_that_of_the_whole_patient_to_second_order(long, arm, kept, monkeypatch):
    """Plain elements: patches are those of the cells that are solved, which is a difference of first order."""
    fem, errors = replace(FEM, kept_factors=kept, volumetric="p1"), []
    monkeypatch.setattr(reduced, "WORTH", 0.9)
    for scale in (0.5, 0.25):
        plan = tiny_plan(*(scale * np.array([1.0, -3.0, 1.5, 2.0])))
        (whole,) = simulate(long, [plan], fem, arm=arm)
        with Simulator(long, fem, arm, amplitude=scale * LIMIT) as simulator:
            (part,) = simulator.solve([plan])
            share = simulator.required(plan).mean()
        assert part.converged and part.kept == kept and 0.1 < share < 0.9
        errors.append(np.linalg.norm(part.displacement - whole.displacement, axis=1).max())
    assert errors[0] < 0.15 and errors[1] < 0.35 * errors[0]


def test_all_is_solved_where_less_does_not_pay_or_does_not_converge(long, monkeypatch, caplog):
    plan = tiny_plan()
    (whole,) = simulate(long, [plan], FEM)
    solver = Simulator(long, FEM, amplitude=1e-6)
    with caplog.at_level(logging.INFO):
        (same,) = solver.solve([plan])
    assert "100 % of the cells are solved" in caplog.text
    np.testing.assert_allclose(same.displacement, whole.displacement, atol=1e-5)
    monkeypatch.setattr(reduced, "WORTH", 1.0)
    monkeypatch.setattr(solver, "_part", lambda *_: replace(whole, converged=False))
    np.testing.assert_array_equal(solver.solve([plan])[0].displacement, same.displacement)
    (still,) = solver.solve([Plan("-", {})])
    solver.close()
    assert still.converged and np.abs(still.displacement).max() < 1e-9


def test_newtons_method_makes_no_linear_map_for_a_plan_of_several_bones(long):
    segment = np.where(np.arange(len(long.bone_points)) % 2, long.bone_segment, 1).astype(np.int8)
    patient = replace(long, bone_segment=segment, segments=("lefort1", "chin"))
    motion = tiny_plan().motions["left"]
    solver = Simulator(patient, replace(FEM, kept_factors=False), amplitude=LIMIT)
    assert solver.required(Plan("-", {"lefort1": motion, "chin": motion})).all() and solver._elastic is None
    solver.required(Plan("-", {"lefort1": motion}))
    assert solver._elastic is not None
    solver.close()


@pytest.mark.parametrize("kept", [True, False])
def test_a_stiffness_without_factors_leaves_all_to_newtons_method(long, kept, monkeypatch, caplog):
    def none(*_, **__):
        raise RuntimeError("no factors")

    monkeypatch.setattr(simulation, "ElasticSolver", none)
    solver = Simulator(long, replace(FEM, kept_factors=kept), amplitude=LIMIT)
    results = solver.solve([tiny_plan(), tiny_plan()])
    solver.close()
    assert all(result.converged for result in results) and caplog.text.count("no kept factors: no factors") == 1


def test_lips_in_contact_are_always_solved(monkeypatch):
    monkeypatch.setattr(reduced, "WORTH", 0.9)
    patient = tiny_patient(shape=(16, 5, 4))
    lip = np.zeros(len(patient.points), np.int8)
    lip[np.argmax(patient.points[:, 0])] = m.UPPER_LIP
    solver = Simulator(replace(patient, lip=lip), FEM, "mucosa+lip", amplitude=LIMIT)
    wanted = solver.required(tiny_plan())
    solver.close()
    around = (patient.cells == np.flatnonzero(lip)[0]).any(axis=1)
    assert wanted[around].all() and not wanted.all()


def test_what_does_not_go_with_a_part_of_the_cells_is_refused(long):
    forces = np.zeros(long.points.shape)
    for wrong in ({"unilateral": True}, {"loads": Loads(forces)}, {"linear": True}):
        with pytest.raises(InputError, match="a part of the cells"):
            Simulator(long, FEM, amplitude=LIMIT, **wrong)
    with Simulator(long, FEM, amplitude=LIMIT) as simulator, pytest.raises(InputError, match="leave out the forces"):
        simulator.solve([tiny_plan()], [forces])
