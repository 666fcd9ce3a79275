"""The lift: linear extensions of the bone's motion, against the solver that they shorten."""

from dataclasses import fields

import numpy as np
import pytest

from pinnochio.geometry.scattered import farthest
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.lift import Lift, control_weights, make_lift, motion_amplitudes
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.model.patient import FIXED, FREE, NO_INTERFACE
from tests.helpers.patients import tiny_patient, tiny_plan

MODEL, PLAN = tiny_patient(), tiny_plan()
MATERIAL = neo_hookean(MODEL.tissue, {MUSCLE: 6.0, SUPERFICIAL: 4.0}, 0.49, 0)


@pytest.fixture(scope="module")
def lift():
    return make_lift(MODEL, MATERIAL, 12)


def carried(lift, plan=PLAN):
    return np.tensordot(motion_amplitudes(plan, MODEL.segments, lift.centre), lift.motions, 1)


def test_the_lift_is_the_elastic_solution_of_any_plan(lift):
    for plan in (PLAN, tiny_plan(x=-4.0, z=0.0, pitch=8.0)):
        boundary = boundary_conditions(MODEL, plan, "mucosa")
        direct = ElasticSolver(MODEL.points, MODEL.cells, MATERIAL, boundary).solve(boundary)
        assert np.abs(direct).max() > 1
        assert np.allclose(carried(lift, plan), direct, atol=1e-5)


def test_departure_of_the_contact_is_carried_inwards_and_not_into_cut_planes(lift):
    amplitudes = lift.smoothing @ np.tile([0.0, 0.0, 1.0], (len(lift.contact), 1))
    field = np.tensordot(amplitudes.ravel(), lift.departures, 1)
    assert np.allclose(field[lift.contact], [0, 0, 1], atol=0.05)
    cut = (MODEL.node_type == FIXED) & (MODEL.interface_kind == NO_INTERFACE)
    assert cut.any() and np.abs(field[cut]).max() == 0
    free = MODEL.node_type == FREE
    assert field[free, 2].min() > -0.3 and 0.2 < field[free, 2].mean() < 1.1


def test_a_departure_is_in_equilibrium(lift):
    nodes = np.flatnonzero(MODEL.node_type != FREE)
    amplitudes = np.random.default_rng(0).normal(size=len(lift.departures)).astype(np.float32)
    field = np.tensordot(amplitudes, lift.departures, 1)
    boundary = BoundaryConditions(nodes, field[nodes])
    direct = ElasticSolver(MODEL.points, MODEL.cells, MATERIAL, boundary).solve(boundary)
    assert np.allclose(field, direct, atol=1e-4)


def test_lift_survives_the_file(lift, tmp_path):
    lift.write(tmp_path / "lift.h5")
    again = Lift.read(tmp_path / "lift.h5")
    for item in fields(Lift):
        assert np.array_equal(getattr(again, item.name), getattr(lift, item.name))
    assert lift.seconds > 0


def test_control_points_are_spread_and_add_up_to_one():
    points = np.random.default_rng(0).uniform(0, 30, (200, 3))
    weights = control_weights(points, 20)
    assert weights.shape == (200, 20) and np.allclose(weights.sum(1), 1) and weights.min() >= 0
    chosen = points[farthest(points, 20)]
    apart = np.linalg.norm(chosen[:, None] - chosen, axis=2) + 1e9 * np.eye(20)
    assert apart.min() > np.linalg.norm(points[:, None] - chosen, axis=2).min(1).max() - 1e-9
    assert control_weights(points[:1], 5).shape == (1, 1)
