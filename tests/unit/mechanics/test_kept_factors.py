"""Many plans by kept factors: Newton's field on blocks, bones and a head, batches, and the way back to Newton."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import boundary_faces
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads, OuterForces
from pinnochio.mechanics.boundary.sliding import SlidingSet, SlidingSurfaces
from pinnochio.mechanics.elements.tetrahedra import node_volumes
from pinnochio.mechanics.problems import BLOCK, block_boundary, box, uniform
from pinnochio.mechanics.simulation import Simulator, simulate
from pinnochio.mechanics.solvers import kept_factors, local_equilibrium
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.mechanics.solvers.local_equilibrium import LocalEquilibrium
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import FREE
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import slab_patient, tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings
from tests.helpers.solids import bent_block, both, material, sphere


def kept(points, cells, law, boundaries, options):
    """Results of several boundary conditions by one set of factors."""
    solver = KeptFactors(points, cells, law, boundaries[0], options)
    try:
        return solver.solve(boundaries)
    finally:
        solver.close()


@both
@pytest.mark.parametrize("stiffening", [0.0, 1.5])
def test_bent_block_as_by_newton(volumetric, stiffening):
    points, cells, boundary = bent_block()
    law, options = material(len(cells), stiffening), fem_settings(volumetric=volumetric, tolerance=1e-8)
    (result,) = kept(points, cells, law, [boundary], options)
    exact = solve(points, cells, law, boundary, options)
    assert result.kept and result.converged and not exact.kept
    assert result.residual <= 1e-8
    np.testing.assert_allclose(result.displacement, exact.displacement, rtol=0, atol=1e-6)
    assert result.min_jacobian == pytest.approx(exact.min_jacobian, abs=1e-6)


@pytest.mark.parametrize("shear", [False, True])
def test_hard_patches_as_by_newton(shear, monkeypatch):
    """Called hard much earlier, patches are at the edges of the supports of the block problem."""
    monkeypatch.setattr(kept_factors, "HARD_RATIO", 0.95)
    points, cells = box(BLOCK, (12, 9, 5))
    boundary, options = block_boundary(points, shear), fem_settings(tolerance=1e-8)
    doubled = BoundaryConditions(boundary.prescribed_nodes, lambda t: 2 * boundary.displacement(t))
    law = uniform(len(cells))
    boundaries = [boundary, doubled]
    for result, condition in zip(kept(points, cells, law, boundaries, options), boundaries, strict=True):
        exact = solve(points, cells, law, condition, options)
        assert result.kept
        np.testing.assert_allclose(result.displacement, exact.displacement, rtol=0, atol=1e-5)
    assert exact.min_jacobian < kept_factors.HARD_RATIO


def test_a_turned_block_takes_few_iterations():
    """Kept factors know nothing of a turn: warped they do, as by a strain of the same turned body."""
    points, cells = box((12, 9, 9), (4, 3, 3), jitter=0.2)
    ends = np.flatnonzero((points[:, 0] == 0) | (points[:, 0] == 12))
    stretch = np.diag([1.2, 1.0, 1.0])

    def result(degrees):
        turn = RigidMotion.from_degrees([0, degrees, 0], [0, 0, 0], [6, 4, 4])
        moved = turn.apply(points[ends] @ stretch) - points[ends]
        return kept(points, cells, uniform(len(cells)), [BoundaryConditions(ends, moved)], fem_settings())[0]

    straight, turned = result(0), result(40)
    assert straight.kept and turned.kept
    assert turned.iterations <= straight.iterations + 3


@pytest.mark.parametrize("arm", ["bonded", "mucosa"])
def test_plans_of_a_patient_as_by_newton_alone_and_together(arm):
    model = slab_patient()
    settings = fem_settings(tolerance=1e-8)
    newton = replace(settings, kept_factors=False)
    plans = [
        Plan("P", {"mandible_distal": RigidMotion.from_degrees([0, turn, 0], shift, [12, 6, 0])})
        for turn, shift in ((2, [2, 1, 1.0]), (-3, [-1, 0, 2.0]), (0, [0, 0, 0]))
    ]
    solver = Simulator(model, settings, arm)
    together = solver.solve(plans)
    for plan, result in zip(plans, together, strict=True):
        (exact,), (alone,) = simulate(model, [plan], newton, arm=arm), solver.solve([plan])
        assert result.kept and alone.kept and exact.converged
        np.testing.assert_allclose(result.displacement, exact.displacement, rtol=0, atol=1e-5)
        np.testing.assert_allclose(alone.displacement, exact.displacement, rtol=0, atol=1e-5)
        assert result.violation < 1e-6
    solver.close()
    assert np.abs(together[2].displacement).max() < 1e-9


def test_another_tissue_on_the_same_factors_as_by_newton():
    """A stiffer patient, from the field of the first; the accuracy counts at every node."""
    model, plan = tiny_patient(), tiny_plan()
    settings = fem_settings(accuracy=0.01)
    stiffer = replace(settings, youngs_modulus={"muscle": 9.0, "superficial": 3.0})
    forces = Loads(np.tile([0, 0, -0.5], (len(model.points), 1)) * node_volumes(model.points, model.cells)[:, None])
    with Simulator(model, settings, everywhere=True) as solver:
        (first,) = solver.solve([plan])
        (result,) = solver.of(stiffer, forces).solve([plan], starts=first.displacement[None])
        (again,) = solver.solve([plan])
    (exact,) = simulate(model, [plan], replace(stiffer, kept_factors=False, accuracy="exact"), loads=forces)
    assert result.kept and np.linalg.norm(exact.displacement - first.displacement, axis=1).max() > 0.1
    assert np.linalg.norm(result.displacement - exact.displacement, axis=1).max() < 0.01
    np.testing.assert_array_equal(again.displacement, first.displacement)


def test_what_does_not_converge_goes_to_newton_and_stops_no_other(monkeypatch):
    points, cells, boundary = bent_block()
    law, options = material(len(cells)), fem_settings()
    easy = BoundaryConditions(boundary.prescribed_nodes, 1e-3 * boundary.displacement(1.0))
    monkeypatch.setattr(kept_factors, "ITERATIONS", 4)
    hard, light = kept(points, cells, law, [boundary, easy], options)
    assert light.kept and light.converged
    assert not hard.kept and hard.converged
    exact = solve(points, cells, law, boundary, options)
    np.testing.assert_array_equal(hard.displacement, exact.displacement)


def test_an_error_in_one_plan_stops_no_other(monkeypatch):
    points, cells, boundary = bent_block()
    easy = BoundaryConditions(boundary.prescribed_nodes, 1e-3 * boundary.displacement(1.0))
    search = KeptFactors._searched

    def failing(self, path, *rest):
        if path.constraints.boundary is boundary:
            raise RuntimeError("no memory")
        return search(self, path, *rest)

    monkeypatch.setattr(KeptFactors, "_searched", failing)
    hard, light = kept(points, cells, material(len(cells)), [boundary, easy], fem_settings())
    assert light.kept and not hard.kept and hard.converged


def test_what_no_solver_solves_says_so():
    points, cells, boundary = bent_block()
    far = BoundaryConditions(boundary.prescribed_nodes, lambda t: 20 * boundary.displacement(t))
    options = fem_settings(max_iterations=3, min_increment=0.5)
    impossible, result = kept(points, cells, material(len(cells)), [far, boundary], options)
    assert not impossible.converged and impossible.reason != "converged"
    assert result.converged


def test_a_time_limit_ends_the_kept_factors_too():
    points, cells, boundary = bent_block()
    (result,) = kept(points, cells, material(len(cells)), [boundary], fem_settings(time_limit=1e-9))
    assert not result.converged and "time limit" in result.reason


def test_other_nodes_are_refused():
    points, cells, boundary = bent_block()
    solver = KeptFactors(points, cells, material(len(cells)), boundary, fem_settings())
    with pytest.raises(InputError, match="other nodes"):
        solver.solve(
            [BoundaryConditions(boundary.prescribed_nodes[1:], np.zeros((len(boundary.prescribed_nodes) - 1, 3)))]
        )
    solver.close()


def test_a_plan_stops_where_the_face_is_as_near_as_was_wished():
    """Fewer iterations the more may be left, and never more is left."""
    model = tiny_patient()
    onto, plans = model.onto_judged, [tiny_plan(*motion) for motion in ((), (0.5, -2, 1, 1), (1.5, 1, 0, 2))]
    exact = simulate(model, plans, fem_settings())
    iterations = [sum(result.iterations for result in exact)]
    for accuracy in (0.02, 0.2, 1.0):
        results = simulate(model, plans, fem_settings(accuracy=accuracy))
        for result, whole in zip(results, exact, strict=True):
            assert result.kept and result.converged and result.min_jacobian > 0
            left = np.linalg.norm(onto @ (result.displacement - whole.displacement), axis=1).max()
            assert left <= accuracy
        iterations.append(sum(result.iterations for result in results))
    assert iterations[0] > iterations[1] > iterations[2] > iterations[3]


def test_lips_in_contact_are_newtons():
    model, plan, settings = tiny_patient(), tiny_plan(), fem_settings()
    result, exact = (
        simulate(model, [plan], replace(settings, kept_factors=kept), arm="mucosa+lip")[0] for kept in (True, False)
    )
    assert not result.kept
    np.testing.assert_array_equal(result.displacement, exact.displacement)


@pytest.mark.parametrize("yielding", [0.0, 0.3])
def test_weight_tension_and_tissue_that_yields_as_by_newton(yielding, monkeypatch):
    """Hard patches are many here, so that the forces beside those of the elements meet them."""
    monkeypatch.setattr(kept_factors, "HARD_RATIO", 0.97)
    model, plan = tiny_patient(), tiny_plan()
    settings = fem_settings(tolerance=1e-8, yielding=yielding)
    faces, _ = boundary_faces(model.cells)
    weight = 0.02 * node_volumes(model.points, model.cells)[:, None] * [0, -1.0, -1.0]
    skin = faces[np.isin(faces, model.skin_nodes).all(axis=1)]
    loads = Loads(weight, skin, np.full(len(skin), 20.0))
    kept, exact = (
        simulate(model, [plan], replace(settings, kept_factors=kept), loads=loads)[0] for kept in (True, False)
    )
    (bare,) = simulate(model, [plan], settings)
    assert kept.kept and exact.converged and not exact.kept
    np.testing.assert_allclose(kept.displacement, exact.displacement, rtol=0, atol=1e-5)
    assert np.abs(kept.displacement - bare.displacement).max() > 0.1


def test_dead_forces_differ_from_plan_to_plan():
    model, plan, settings = tiny_patient(), tiny_plan(), fem_settings(tolerance=1e-8)
    forces = np.where(model.node_type[:, None] == FREE, [0, 0, -1.0], 0)
    first, second = simulate(model, [plan, plan], settings, [0 * forces, forces])
    newton = replace(settings, kept_factors=False)
    assert first.kept and second.kept
    for result, load in ((first, None), (second, Loads(forces))):
        (exact,) = simulate(model, [plan], newton, loads=load)
        np.testing.assert_allclose(result.displacement, exact.displacement, rtol=0, atol=1e-5)


@pytest.mark.parametrize("arm", ["bonded", "mucosa"])
def test_few_nodes_out_of_equilibrium_come_to_rest_by_themselves(arm, monkeypatch):
    """To the field of steps of the whole part; parts about the nodes alone are factorised again and again."""
    patient, settings, plan = tiny_patient(shape=(14, 9, 8)), fem_settings(), tiny_plan()
    boundary, law = boundary_conditions(patient, plan, arm), settings.material(patient.tissue)
    solver = KeptFactors(patient.points, patient.cells, law, boundary, fem_settings(tolerance=1e-9))
    constraints, elements = solver._constraints.under(boundary), solver._elements
    (exact,) = solver.solve([boundary])
    inner = int(np.argmin(np.linalg.norm(patient.points - patient.points.mean(axis=0), axis=1)))
    disturbed = exact.displacement.copy()
    disturbed[inner] += [0.0, 0.0, 6.0]
    sizes, factorize = [], LocalEquilibrium._factorize
    monkeypatch.setattr(
        LocalEquilibrium, "_factorize", lambda self, *a: sizes.append(self.inside.sum()) or factorize(self, *a)
    )
    for few in (0.0, 0.1):
        monkeypatch.setattr(local_equilibrium, "FEW", few)
        every = np.ones(len(elements.patch_volumes), bool)
        conditions = constraints.constrained, constraints.sliding.nodes, every, OuterForces(patient.points, None)
        part, u = LocalEquilibrium(elements, *conditions, "auto", True), disturbed.copy()
        held = constraints.sliding.at(1.0)
        sizes.clear()
        done = part.settled(u, held, held.project(u), 1e-3, 1.0)
        np.testing.assert_allclose(done.displacement, exact.displacement, rtol=0, atol=1e-4)
        assert (min(sizes) < max(sizes) / 2) == (few > 0)
        part.close()
    solver.close()


def sliding_on_a_sphere(motion, near=1.0):
    """Nodes about a sphere of 20 mm that has moved, and their surface of 1,200 points."""
    points, normals = sphere(20.0, 1200)
    nodes = near * points[::31]
    sets = [SlidingSet(np.arange(len(nodes)), points, normals, motion.fraction)]
    return nodes, SlidingSurfaces(nodes, sets)


TURNED = RigidMotion.from_degrees([5, -20, 10], [3, 1, -2], [10, 0, 0])


@pytest.mark.parametrize("degrees", [0, 60])
@pytest.mark.parametrize("near", [0.97, 1.08])
def test_held_nodes_return_to_the_surface(near, degrees):
    """Far away from where it was at rest, a node meets points of the bone that were not listed for it."""
    nodes, sliding = sliding_on_a_sphere(TURNED, near)
    held = sliding.at(1.0)
    slid = RigidMotion.from_degrees([0, 0, degrees], [0, 0, 0], [0, 0, 0]).apply(nodes)
    u = TURNED.apply(slid) - nodes + np.random.default_rng(0).normal(0, 0.5, nodes.shape)
    back = u.copy()
    axes = held.project(back)
    assert np.abs(held.violation(back)).max() < 1e-9 < np.abs(held.violation(u)).max()
    away = nodes + back - TURNED.apply(np.zeros((1, 3)))
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 20 * near, rtol=0, atol=0.02)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), axes.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1)
    assert (axes[:, 0] * away).sum(axis=1).min() > 0.9999 * 20 * near - 0.02
    again = back.copy()
    held.project(again)
    np.testing.assert_array_equal(again, back)


def test_curvature_under_held_nodes_is_that_of_the_sphere():
    nodes, sliding = sliding_on_a_sphere(TURNED, 1.05)
    held = sliding.at(1.0)
    u = TURNED.displacement(nodes) + 0.3
    axes, force = held.project(u), np.random.default_rng(1).normal(0, 5, nodes.shape)
    push = -(force * axes[:, 0]).sum(axis=1) / 21
    expected = push[:, None, None] * np.diag([0.0, 1, 1])
    np.testing.assert_allclose(held.curvature(u, axes, force), expected, rtol=0, atol=0.1 * np.abs(push).max())


def test_what_fails_at_once_is_reached_in_increments(monkeypatch):
    """A plan that may have ended elsewhere takes the way over smaller loads, by the kept factors still."""
    points, cells, boundary = bent_block()
    law, options = material(len(cells)), fem_settings(tolerance=1e-8)
    doubts = iter(["elsewhere"])
    monkeypatch.setattr(KeptFactors, "_elsewhere", lambda *_: next(doubts, ""))
    (result,) = kept(points, cells, law, [boundary], options)
    assert result.kept and [entry["fraction"] for entry in result.history if entry["residual"] <= 1e-8] == [1.0]
    assert {entry["fraction"] for entry in result.history} == {0.25, 0.5, 0.75, 1.0}
    exact = solve(points, cells, law, boundary, options)
    np.testing.assert_allclose(result.displacement, exact.displacement, rtol=0, atol=1e-6)


def test_the_least_increments_decide_what_larger_ones_doubt(monkeypatch):
    points, cells, boundary = bent_block()
    monkeypatch.setattr(KeptFactors, "_elsewhere", lambda *_: "elsewhere")
    (result,) = kept(points, cells, material(len(cells)), [boundary], fem_settings())
    assert result.kept and min(entry["fraction"] for entry in result.history) == kept_factors.LEAST_INCREMENT


def test_a_node_far_from_those_beside_it_is_doubted():
    points, cells, boundary = bent_block()
    solver = KeptFactors(points, cells, material(len(cells)), boundary, fem_settings())
    start, edge = np.zeros(points.shape), solver._elements.edge
    alone, all_of_them = start.copy(), start + 3 * edge
    alone[-1, 0] = 1.1 * edge
    axes = np.zeros((0, 3, 3))
    states = [solver._iterate(u, 0, 1, axes, 0 * u) for u in (alone, all_of_them)]
    reasons = [solver._elsewhere(start, axes[:, 0], state) for state in states]
    reasons.append(solver._elsewhere(start, axes[:, 0], solver._iterate(0.7 * alone, 0, 1, axes, 0 * alone)))
    turned = solver._iterate(0.7 * alone, 0, 1, axes, 0 * alone)._replace(axes=np.eye(3)[None, [1, 2, 0]])
    assert "rim" in solver._elsewhere(start, np.eye(3)[:1], turned)
    assert "strayed" in reasons[0] and reasons[1:] == ["", ""]
    solver.close()
