"""Contact that opens and closes: between blocks, and as an arm of a plan."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import boundary_faces
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.contact import UnilateralContact, penalty
from pinnochio.mechanics.boundary.lips import facing_sets
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.model.patient import LOWER_LIP, UPPER_LIP
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import slab_patient
from tests.helpers.settings import fem_settings

KAPPA = 40.0


def stacked(gap, upper=((12, 9, 6), (4, 3, 2)), lower=((18, 15, 6), (5, 4, 2)), offset=(3.0, 3.0), jitter=0.0):
    """Two boxes, the first `gap` mm above the second: points, cells, and the nodes of the faces that face."""
    one, first = box(*upper, jitter=jitter)
    two, second = box(*lower, jitter=jitter, seed=1)
    top = two[:, 2].max()
    above = np.flatnonzero(one[:, 2] == 0)
    below = np.flatnonzero(two[:, 2] == top) + len(one)
    points = np.vstack([one + [*offset, top + gap], two])
    return points, np.vstack([first, second + len(one)]), above, below


def lips(points, cells, above, below):
    return facing_sets(points, boundary_faces(cells)[0], above, below)


def dense(contact, u):
    """The tangent as a symmetric matrix (3 n, 3 n)."""
    pairs, blocks = contact.tangent(u)
    assert (pairs[:, 0] <= pairs[:, 1]).all() and len(np.unique(pairs, axis=0)) == len(pairs)
    assert {tuple(pair) for pair in pairs} <= {tuple(pair) for pair in contact.pairs}
    whole = np.zeros((len(u), 3, len(u), 3))
    for (a, b), block in zip(pairs, blocks, strict=True):
        whole[a, :, b] = block
        whole[b, :, a] = block.T
    return whole.reshape(3 * len(u), -1)


def slopes(contact, u, nodes, step):
    """Central differences of energy (k, 3), gradient (k, 3, n, 3) and gaps (k, 3, s) by the displacement of nodes."""
    energy, force = np.zeros((len(nodes), 3)), np.zeros((len(nodes), 3, *u.shape))
    gaps = np.zeros((len(nodes), 3, len(contact.nodes)))
    for row, node in enumerate(nodes):
        for axis in range(3):
            move = np.zeros_like(u)
            move[node, axis] = step
            (high, up), (low, down) = (contact.evaluate(u + sign * move) for sign in (1, -1))
            energy[row, axis], force[row, axis] = (high - low) / (2 * step), (up - down) / (2 * step)
            gaps[row, axis] = (contact.gaps(u + move) - contact.gaps(u - move)) / (2 * step)
    return energy, force, gaps


def test_force_is_the_gradient_of_the_energy_between_deformed_surfaces():
    points, cells, above, below = stacked(0.3)
    sets = lips(points, cells, above, below)
    contact = UnilateralContact(points, sets, KAPPA)
    u = np.random.default_rng(1).normal(0, 0.2, points.shape)
    u[: len(points) - 5 * 6 * 3] += [1.4, 0, -0.4]
    gaps = contact.gaps(u)
    assert 5 < (gaps < 0).sum() < len(gaps) - 5
    _, force = contact.evaluate(u)
    nodes = np.flatnonzero(np.abs(force).max(axis=1) > 0)
    assert len(nodes) > 25
    numeric, _, slope = slopes(contact, u, nodes, 1e-5)
    np.testing.assert_allclose(force[nodes], numeric, atol=1e-6 * np.abs(force).max())
    # The tangent is that of springs along the gradients of the gaps.
    springs = KAPPA / 2 * np.concatenate([item.areas for item in sets]) * (gaps < 0)
    expected = np.einsum("kis,s,ljs->kilj", slope, springs, slope)
    whole = dense(contact, u).reshape(len(u), 3, len(u), 3)
    np.testing.assert_allclose(whole[np.ix_(nodes, range(3), nodes, range(3))], expected, atol=1e-5 * whole.max())


def test_lips_push_each_other_alike():
    """The forces on both sides cancel, and their moments about any point, however the surfaces bend and slide."""
    points, cells, above, below = stacked(0.0, jitter=0.2)
    contact = UnilateralContact(points, lips(points, cells, above, below), KAPPA)
    u = np.random.default_rng(2).normal(0, 0.3, points.shape) + [0.7, -0.4, 0]
    _, force = contact.evaluate(u)
    assert np.abs(force).max() > 1
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * size
    assert np.abs(np.cross(points + u, force).sum(axis=0)).max() < 1e-12 * size
    # A rigid motion of both changes neither gaps nor energy.
    turn = RigidMotion.from_degrees([30, -20, 50], [5, 8, -3], [1, 2, 3])
    moved = turn.apply(points + u) - points
    np.testing.assert_allclose(contact.gaps(moved), contact.gaps(u), atol=1e-12)


@pytest.mark.parametrize("shift", [0.0, 2.2])
def test_tangent_between_flat_surfaces_approaches_the_hessian(shift):
    """What the tangent leaves out is in proportion to the depth."""
    points, cells, above, below = stacked(0.0)
    contact = UnilateralContact(points, lips(points, cells, above, below), KAPPA)
    wrong = []
    for depth in (2e-3, 1e-3):
        u = np.zeros_like(points)
        u[: len(points) - 5 * 6 * 3] = [shift, shift / 2, -depth]
        whole = dense(contact, u)
        touched = np.flatnonzero(np.abs(whole).max(axis=1).reshape(-1, 3).max(axis=1) > 0)
        _, curve, _ = slopes(contact, u, touched, depth / 20)
        rows = whole.reshape(len(u), 3, len(u), 3)[touched]
        wrong.append(np.abs(rows - curve).max() / np.abs(whole).max())
    assert wrong[1] < 2e-3 and wrong[0] / wrong[1] == pytest.approx(2, rel=0.1)
    assert np.linalg.eigvalsh(whole)[-1] > KAPPA


def test_gaps_start_at_rest():
    """Open at rest: the gap is kept and may close. Inside at rest: no force until it goes deeper."""
    points, cells, above, below = stacked(0.5)
    contact = UnilateralContact(points, lips(points, cells, above, below), KAPPA)
    np.testing.assert_allclose(contact.gaps(0 * points)[: len(above)], 0.5, atol=1e-12)
    upper = np.arange(len(points)) < len(points) - 5 * 6 * 3
    for move, expected in ((-0.3, 0.2), (-0.7, -0.2), (1.0, 1.5)):
        u = np.where(upper[:, None], [0, 0, move], 0.0)
        np.testing.assert_allclose(contact.gaps(u)[: len(above)], expected, atol=1e-12)
        force = contact.evaluate(u)[1][above, 2]
        # The half that the lower nodes push back with may move the upper's corners either way: the sum is the answer.
        assert (force.sum() < 0) == (expected < 0) and (expected < 0 or (force == 0).all())
    points, cells, above, below = stacked(-0.4)
    contact = UnilateralContact(points, lips(points, cells, above, below), KAPPA)
    assert contact.evaluate(0 * points)[0] == 0
    np.testing.assert_array_equal(contact.gaps(0 * points)[: len(above)], 0)
    u = np.where((np.arange(len(points)) < len(points) - 5 * 6 * 3)[:, None], [0, 0, -0.1], 0.0)
    np.testing.assert_allclose(contact.gaps(u)[: len(above)], -0.1, atol=1e-12)


def test_blocks_pressed_evenly_bear_the_stiffness_times_the_depth_once():
    """Two equal faces of 12 by 9 mm, each against the other: together they push as one spring of kappa per area."""
    points, cells, above, below = stacked(0.0, lower=((12, 9, 6), (4, 3, 2)), offset=(0, 0))
    contact = UnilateralContact(points, lips(points, cells, above, below), KAPPA)
    upper = (np.arange(len(points)) < len(points) // 2)[:, None]
    energy, force = contact.evaluate(np.where(upper, [0, 0, -0.1], 0.0))
    np.testing.assert_allclose((force * upper).sum(axis=0), [0, 0, -KAPPA * 0.1 * 108], atol=1e-9)
    assert energy == pytest.approx(KAPPA / 2 * 0.1**2 * 108)
    # Half beside each other, half of it is left, but for what fades at the border.
    force = contact.evaluate(np.where(upper, [6, 0, -0.1], 0.0))[1]
    assert (force * upper).sum(axis=0)[2] == pytest.approx(-KAPPA * 0.1 * 54, rel=0.3)
    assert not contact.evaluate(np.where(upper, [14, 0, -0.1], 0.0))[1].any()


def test_pressed_and_shifted_blocks_transmit_pressure_but_no_shear():
    points, cells, above, below = stacked(0.0)
    law = uniform(len(cells), poisson=0.45)
    elements = Elements.build(points, cells, law)
    sets = lips(points, cells, above, below)
    top, bottom = (np.flatnonzero(points[:, 2] == z) for z in (12, 0))
    prescribed = np.concatenate([top, bottom])
    contact = UnilateralContact(points, sets, penalty(elements.modulus, elements.edge))
    loads = []
    for shift in (0.0, 2.0):
        move = np.where(np.isin(prescribed, top)[:, None], [shift, 0, -1.2], 0.0)
        result = solve(
            points, cells, law, BoundaryConditions(prescribed, move, contact=sets), fem_settings(tolerance=1e-6)
        )
        assert result.converged
        u = result.displacement
        upper = np.arange(len(points)) < len(points) - 5 * 6 * 3
        loads.append(-contact.evaluate(u)[1][upper].sum(axis=0))
        reaction = elements.evaluate(u)[1][top].sum(axis=0)
        np.testing.assert_allclose(reaction, -loads[-1], atol=1e-4 * np.abs(reaction).max())
        area = 12 * 9
        assert contact.gaps(u).min() > -0.06 * loads[-1][2] / area * 3  # the edges bear more than the mean
    assert loads[0][2] / area > 0.3
    assert np.abs(np.array(loads)[:, :2]).max() < 0.01 * loads[0][2]
    assert loads[1][2] == pytest.approx(loads[0][2], rel=0.04)  # other nodes carry it


def test_penalty_keeps_one_kilopascal_within_its_depth():
    """At the moduli of tissue and mesh edges of 3 to 9 mm, 1 kPa enters less than 0.05 mm."""
    for modulus in (1.3, 2.0):
        for edge in (3.0, 6.0):
            assert 1 / penalty(modulus, edge) < 0.05


def test_the_arm_with_lips():
    model = slab_patient()
    plan = Plan("P01", {"mandible_distal": RigidMotion(np.eye(3), np.array([2.0, 0, -1]), np.zeros(3))})
    plain = boundary_conditions(model, plan, "mucosa")
    same = boundary_conditions(model, plan, "mucosa+lip")  # no lips
    assert not plain.contact and not same.contact
    assert [list(item.nodes) for item in plain.sliding] == [list(item.nodes) for item in same.sliding]
    # A slit across the slab, 3 mm wide: its walls stand in for lips.
    x, _, z = (np.round(model.points / 3) * 3).T
    slit = np.isin(x[model.cells], (12, 15)).all(axis=1) & (z[model.cells] >= 3).all(axis=1)
    lip = np.where(z > 3, np.where(x == 12, UPPER_LIP, np.where(x == 15, LOWER_LIP, 0)), 0)
    model = replace(model, lip=lip.astype(np.int8), cells=model.cells[~slit])
    lipped = boundary_conditions(model, plan, "mucosa+lip")
    assert len(lipped.contact) == 2
    for item, lip in zip(lipped.contact, (UPPER_LIP, LOWER_LIP), strict=True):
        np.testing.assert_array_equal(item.nodes, np.flatnonzero(model.lip == lip))
        assert not np.isin(item.faces, item.nodes).any() and len(item.faces)
        assert (np.round(model.points[item.faces][..., 0] / 3) * 3 == 27 - x[item.nodes[0]]).all()
    assert not boundary_conditions(model, plan, "mucosa").contact
    gaps = UnilateralContact(model.points, lipped.contact, KAPPA).gaps(0 * model.points)
    assert gaps.min() > 2.3 and gaps.max() < 3.7


def test_unusable_contact_is_refused():
    points, cells, above, below = stacked(0.0)
    one, two = lips(points, cells, above, below)
    for bad, words in (
        (replace(one, nodes=np.append(above[:-1], above[0])), "twice"),
        (replace(one, areas=-one.areas), "areas"),
        (replace(one, faces=np.zeros((0, 3), int)), "no faces"),
        (replace(one, faces=two.faces), "its own surface"),
    ):
        with pytest.raises(InputError, match=words):
            UnilateralContact(points, [bad], KAPPA)
    with pytest.raises(InputError, match="stiffness"):
        UnilateralContact(points, [one, two], 0.0)
    empty = UnilateralContact(points, [], KAPPA)
    assert empty.evaluate(0 * points)[0] == 0 and len(empty.gaps(0 * points)) == 0
    assert empty.pairs.shape == (0, 2) and empty.tangent(0 * points)[1].shape == (0, 3, 3)
