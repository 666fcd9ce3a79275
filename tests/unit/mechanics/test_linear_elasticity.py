"""The linear fast path: the small-motion limit of the nonlinear solver, refusals, and factors that serve every plan."""

import numpy as np
import pytest

from pinnochio import mechanics
from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.sliding import SlidingSet
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import slab_patient, tiny_plan
from tests.helpers.settings import fem_settings
from tests.helpers.solids import both, plane


@both
@pytest.mark.parametrize("arm", ["bonded", "mucosa"])
def test_small_motions_give_what_newton_gives(volumetric, arm):
    model = slab_patient()
    law = uniform(len(model.cells))
    rest = boundary_conditions(model, Plan("P01", {}), arm)
    solver = ElasticSolver(model.points, model.cells, law, rest, volumetric)
    for shift in ([2e-4, 1e-4, 1e-4], [-1e-4, 0, 2e-4]):
        plan = Plan("P01", {"mandible_distal": RigidMotion.from_degrees([0, 1e-3, 0], shift, [12, 6, 0])})
        boundary = boundary_conditions(model, plan, arm)
        linear = solver.solve(boundary)
        exact = solve(model.points, model.cells, law, boundary, fem_settings(volumetric=volumetric, tolerance=1e-10))
        assert exact.converged
        size = np.abs(exact.displacement).max()
        np.testing.assert_allclose(linear, exact.displacement, rtol=0, atol=2e-4 * size)
    solver.close()


def test_large_motions_are_proportional():
    """Twice the lift, twice the field; a plane that the block slides along may travel within itself unnoticed."""
    points, cells = box((12, 9, 9), (4, 3, 3), jitter=0.2)
    bottom, top = np.flatnonzero(points[:, 2] == 0), np.flatnonzero(points[:, 2] == 9)

    def boundary(lift, travel):
        motion = RigidMotion.from_degrees([0, 0, 0], [travel, 0, lift], [0, 0, 0])
        flat = SlidingSet(top, *plane([0, 0, 1], [6.0, 4, 9]), motion.fraction)
        return BoundaryConditions(bottom, np.zeros((len(bottom), 3)), [flat])

    solver = ElasticSolver(points, cells, uniform(len(cells)), boundary(0, 0))
    once, twice, travelled = (solver.solve(boundary(*x)) for x in ((1.0, 0.0), (2.0, 0.0), (1.0, 5.0)))
    np.testing.assert_allclose(twice, 2 * once, atol=1e-10)
    np.testing.assert_allclose(travelled, once, atol=1e-10)
    np.testing.assert_allclose(once[top, 2], 1.0, atol=1e-10)
    assert np.abs(once[:, :2]).max() > 0.1
    other = BoundaryConditions(bottom[1:], np.zeros((len(bottom) - 1, 3)))
    with pytest.raises(InputError, match="other nodes"):
        solver.solve(other)
    solver.close()


def test_the_door_gives_the_linear_field():
    model, plan, settings = slab_patient(), tiny_plan(), fem_settings()
    plan = Plan("P", {"mandible_distal": plan.motions["left"]})
    boundary = boundary_conditions(model, plan, "mucosa")
    solver = ElasticSolver(model.points, model.cells, settings.material(model.tissue), boundary)
    (result,) = mechanics.simulate(model, [plan], settings, linear=True)
    np.testing.assert_array_equal(result.displacement, solver.solve(boundary))
    ratios = jacobians(model.points, model.cells, result.displacement)
    assert result.converged and result.min_jacobian == pytest.approx(ratios.min())
    solver.close()
