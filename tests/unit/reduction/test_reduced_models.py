"""Scenes: the cells that a plan requires, what holds the others, the field of the whole patient; parts of a plan."""

import logging
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.contact import ContactSet
from pinnochio.mechanics.simulation import PlanSolver
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.reduced import moved_cells, restricted
from pinnochio.model import patient as m
from pinnochio.plans.plan import Plan
from pinnochio.plans.scenarios import parts
from pinnochio.reduction import solver as reduction
from pinnochio.reduction.solver import ReducedSolver
from pinnochio.tables.reductions import TRIALS, summarise
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
    own, held = np.unique(long.cells[wanted]), np.unique(long.cells[~wanted])
    np.testing.assert_array_equal(nodes, own)
    before = np.isin(whole.prescribed_nodes, own)
    count = before.sum()
    np.testing.assert_array_equal(nodes[part.prescribed_nodes[:count]], whole.prescribed_nodes[before])
    cut = nodes[part.prescribed_nodes[count:]]
    np.testing.assert_array_equal(cut, np.setdiff1d(np.intersect1d(own, held), whole.prescribed_nodes))
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
    monkeypatch.setattr(reduction, "WORTH", 0.9)
    for scale in (0.5, 0.25):
        plan = tiny_plan(*(scale * np.array([1.0, -3.0, 1.5, 2.0])))
        solvers = PlanSolver(long, arm, fem), ReducedSolver(long, arm, fem, scale * LIMIT)
        (whole,), (part,) = (solver.solve([plan]) for solver in solvers)
        share = solvers[1].required(plan).mean()
        for solver in solvers:
            solver.close()
        assert part.converged and part.kept == kept and 0.1 < share < 0.9
        errors.append(np.linalg.norm(part.displacement - whole.displacement, axis=1).max())
    assert errors[0] < 0.15 and errors[1] < 0.35 * errors[0]


def test_all_is_solved_where_less_does_not_pay_or_does_not_converge(long, monkeypatch, caplog):
    plan = tiny_plan()
    alone = PlanSolver(long, "mucosa", FEM)
    (whole,) = alone.solve([plan])
    alone.close()
    solver = ReducedSolver(long, "mucosa", FEM, 1e-6)
    with caplog.at_level(logging.INFO):
        (same,) = solver.solve([plan])
    assert "100 % of the cells are solved" in caplog.text
    np.testing.assert_allclose(same.displacement, whole.displacement, atol=1e-5)
    monkeypatch.setattr(reduction, "WORTH", 1.0)
    monkeypatch.setattr(solver, "_part", lambda *_: replace(whole, converged=False))
    np.testing.assert_array_equal(solver.solve([plan])[0].displacement, same.displacement)
    (still,) = solver.solve([Plan("-", {})])
    solver.close()
    assert still.converged and np.abs(still.displacement).max() < 1e-9


def test_newtons_method_makes_no_linear_map_for_a_plan_of_several_bones(long):
    segment = np.where(np.arange(len(long.bone_points)) % 2, long.bone_segment, 1).astype(np.int8)
    patient = replace(long, bone_segment=segment, segments=("lefort1", "chin"))
    own = tiny_plan().motions["left"]
    solver = ReducedSolver(patient, "mucosa", replace(FEM, kept_factors=False), LIMIT)
    assert solver.required(Plan("-", {"lefort1": own, "chin": own})).all() and solver._map is None
    solver.required(Plan("-", {"lefort1": own}))
    assert solver._map is not None
    solver.close()


@pytest.mark.parametrize("kept", [True, False])
def test_a_stiffness_without_factors_leaves_all_to_newtons_method(long, kept, monkeypatch, caplog):
    def none(*_, **__):
        raise RuntimeError("no factors")

    monkeypatch.setattr(reduction, "ElasticSolver", none)
    solver = ReducedSolver(long, "mucosa", replace(FEM, kept_factors=kept), LIMIT)
    results = solver.solve([tiny_plan(), tiny_plan()])
    solver.close()
    assert all(result.converged for result in results) and caplog.text.count("no kept factors: no factors") == 1


def test_lips_in_contact_are_always_solved(monkeypatch):
    monkeypatch.setattr(reduction, "WORTH", 0.9)
    patient = tiny_patient(shape=(16, 5, 4))
    lip = np.zeros(len(patient.points), np.int8)
    lip[np.argmax(patient.points[:, 0])] = m.UPPER_LIP
    solver = ReducedSolver(replace(patient, lip=lip), "mucosa+lip", FEM, LIMIT)
    wanted = solver.required(tiny_plan())
    solver.close()
    around = (patient.cells == np.flatnonzero(lip)[0]).any(axis=1)
    assert wanted[around].all() and not wanted.all()


def test_parts_of_a_plan_compose_to_it():
    jaw = RigidMotion.from_degrees([3, 1, -2], [1, -6, 2], [0, -60, -60])
    centre = np.array([0.0, -90, -80])
    advance = RigidMotion(translation=np.array([0.0, -4, 0]))
    whole = advance.apply(jaw.apply(centre[None]))[0] - centre
    chin = RigidMotion(advance.rotation @ jaw.rotation, whole, centre)
    upper = RigidMotion(translation=np.array([0.0, -3, 0]))
    plan = Plan("-", {"lefort1": upper, "mandible_distal": jaw, "chin": chin})
    by_name = parts(plan, centre)
    assert list(by_name) == ["lefort1", "mandible", "genioplasty", "bimaxillary"]
    assert set(by_name["mandible"].motions) == {"mandible_distal", "chin"} and by_name["bimaxillary"] == plan
    points = np.random.default_rng(1).normal(centre, 10, (5, 3))
    own = by_name["genioplasty"].motions["chin"]
    np.testing.assert_allclose(own.apply(jaw.apply(points)), chin.apply(points), atol=1e-9)
    same = Plan("-", {"mandible_distal": jaw, "chin": jaw})
    np.testing.assert_array_equal(parts(same, centre)["genioplasty"].motions["chin"].translation, [0, -5, 0])
    assert list(parts(Plan("-", {"lefort1": upper}))) == ["lefort1"]


def test_summary_compares_with_the_whole_patient_and_says_what_pays():
    row = {column.name: 1 if column.kind in (int, float) else "x" for column in TRIALS} | {"converged": True}
    full = row | {"model": "full", "error_mean": 0, "error_max": 0, "first_seconds": 3, "further_seconds": 2}
    auto = row | {"model": "auto", "share": 0.4, "error_mean": 0.1, "error_max": 0.4}
    other = auto | {"case": "B", "error_mean": 0.3, "error_max": 0.2, "converged": False}
    slow = {"plan": "y", "further_seconds": 3}
    rows = [full, auto, full | {"case": "B"}, other, full | slow | {"further_seconds": 2}, auto | slow]
    summary = summarise(pd.DataFrame([*rows, full | {"plan": "z"}, auto | {"plan": "z", "share": 1.0}]))
    assert summary["n"].tolist() == [2, 1, 1] and summary["failed"].tolist() == [1, 0, 0]
    assert summary["reduced"].tolist() == [2, 1, 0]
    assert summary.loc[0, ["error_mean", "error_mean_max", "error_max"]].tolist() == pytest.approx([0.2, 0.3, 0.4])
    ratios = summary.loc[0, ["further_ratio", "first_ratio", "whole_ratio"]].tolist()
    assert ratios == pytest.approx([2, 3, 4 / 2])
    assert summary["pays"].tolist() == ["one plan, many plans", "one plan", "not made"]
