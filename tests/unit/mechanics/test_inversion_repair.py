"""The inversion repair: wild fields come out valid, near ones untouched, interfaces stay where they can."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.solvers.inversion_repair import FLOOR, damped, repair_inversions
from pinnochio.mechanics.solvers.newton import solve
from tests.helpers.settings import fem_settings
from tests.helpers.solids import bent_block

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def bent():
    """Mesh, law, field in equilibrium and interface of a bent block."""
    points, cells, boundary = bent_block((16, 8, 6))
    law = uniform(len(cells))
    constrained = np.zeros(len(points), bool)
    constrained[boundary.prescribed_nodes] = True
    result = solve(points, cells, law, boundary, fem_settings(tolerance=1e-8))
    assert result.converged and result.min_jacobian > 0.3
    return points, cells, law, result.displacement, constrained


def through(points, cells, field, cell, corner=0, way=1.6):
    """The field with one corner of a cell pushed through the opposite face."""
    x, broken = points + field, field.copy()
    a, others = cells[cell][corner], np.delete(cells[cell], corner)
    broken[a] += way * (x[others].mean(axis=0) - x[a])
    return broken


def constrained_corners(cells, constrained, count):
    return np.flatnonzero(constrained[cells].sum(axis=1) == count)


@pytest.mark.parametrize("seed", range(4))
def test_jacobians_are_determinants_of_edges_after_and_before(seed):
    points, cells = box((9, 7, 5), (3, 2, 2), jitter=0.3, seed=seed)
    field = RNG(seed).normal(size=points.shape)
    after, before = (np.linalg.det(x[cells[:, 1:]] - x[cells[:, :1]]) for x in (points + field, points))
    np.testing.assert_allclose(jacobians(points, cells, field), after / before, atol=1e-12)


def test_a_sound_field_is_handed_back_as_it_is(bent):
    points, cells, law, field, constrained = bent
    kept, repair = repair_inversions(points, cells, law, field, constrained)
    assert kept is field
    assert (repair.elements, repair.nodes, repair.damping, repair.raw_inverted) == (0, 0, 1.0, 0)
    assert repair.raw_least == repair.least == pytest.approx(jacobians(points, cells, field).min())


@pytest.mark.parametrize("volumetric", ["patch", "p1"])
@pytest.mark.parametrize("seed", range(3))
def test_one_collapsed_element_is_mended_where_it_is(bent, volumetric, seed):
    """In a field in equilibrium the repair must bring the equilibrium back, and touch no node of the interface."""
    points, cells, law, field, constrained = bent
    cell = RNG(seed).choice(constrained_corners(cells, constrained, 0))
    broken = through(points, cells, field, cell)
    kept, repair = repair_inversions(points, cells, law, broken, constrained, volumetric)
    assert repair.raw_inverted >= 1 and repair.raw_least < 0 < FLOOR <= repair.least
    assert repair.damping == 1 and repair.interface == 0 and repair.elements < len(cells) / 4
    np.testing.assert_array_equal(kept[constrained], field[constrained])
    moved = np.flatnonzero((kept != broken).any(axis=1))
    assert len(moved) == repair.nodes and np.isin(cells[cell][0], moved)
    assert repair.change == pytest.approx(np.linalg.norm(kept - broken, axis=1).max())
    off = np.linalg.norm(kept - field, axis=1).max()
    assert off < (0.02 if volumetric == "patch" else 0.3) * np.linalg.norm(broken - field, axis=1).max()


def test_an_element_below_the_floor_counts_as_bad_and_one_above_it_does_not(bent):
    points, cells, law, field, constrained = bent
    cell = constrained_corners(cells, constrained, 0)[5]
    ways = [(way, jacobians(points, cells, through(points, cells, field, cell, way=way)).min()) for way in (0.5, 0.97)]
    assert 0 < ways[1][1] < FLOOR < ways[0][1]
    for way, least in ways:
        kept, repair = repair_inversions(points, cells, law, through(points, cells, field, cell, way=way), constrained)
        assert (repair.elements > 0) == (least < FLOOR) and repair.least >= FLOOR and repair.raw_inverted == 0


def test_an_interface_that_is_itself_the_cause_is_freed_there_and_nowhere_else(bent):
    points, cells, law, field, constrained = bent
    cell = constrained_corners(cells, constrained, 3)[3]
    corner = np.flatnonzero(constrained[cells[cell]])[0]
    whole = constrained.copy()
    whole[cells[cell]] = True  # now no node of the element is free
    broken = through(points, cells, field, cell, corner)
    kept, repair = repair_inversions(points, cells, law, broken, whole)
    assert repair.least >= FLOOR and repair.damping == 1 and 1 <= repair.interface <= 8
    moved = np.flatnonzero((kept != broken).any(axis=1) & whole)
    near = np.unique(cells[(broken != field).any(axis=1)[cells].any(axis=1)])
    assert np.isin(moved, near).all() and np.isin(cells[cell][corner], moved)


@pytest.mark.parametrize("noise", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("interface_too", [False, True])
def test_noise_is_mended_without_damping(bent, noise, interface_too):
    """The edges are 2.5 mm long."""
    points, cells, law, field, constrained = bent
    rough = field + noise * RNG(2).normal(size=field.shape) * (interface_too | ~constrained)[:, None]
    kept, repair = repair_inversions(points, cells, law, rough, constrained)
    assert jacobians(points, cells, kept).min() > 0 and repair.damping == 1
    assert repair.least == pytest.approx(jacobians(points, cells, kept).min())
    assert repair.raw_inverted == (jacobians(points, cells, rough) <= 0).sum() > 0
    if not interface_too:
        assert repair.interface == 0
        np.testing.assert_array_equal(kept[constrained], field[constrained])
    untouched = (kept == rough).all(axis=1)
    assert untouched.sum() == len(points) - repair.nodes


@pytest.mark.parametrize(
    "field",
    [
        lambda x: -2 * (x - x.mean(axis=0)) * [1, 0, 0],  # mirrored
        lambda x: -2 * (x - x.mean(axis=0)),  # turned inside out
        lambda x: x.mean(axis=0) - x,  # all in one point
        lambda x: 30 * RNG(0).normal(size=x.shape),
        lambda x: 1e5 * RNG(0).normal(size=x.shape),
    ],
)
def test_what_nothing_mends_is_damped_as_little_as_that_takes(bent, field):
    points, cells, law, _, constrained = bent
    wild = field(points)
    kept, repair = repair_inversions(points, cells, law, wild, constrained)
    assert 0 < repair.damping < 1 and jacobians(points, cells, kept).min() >= FLOOR * (1 - 1e-9)
    np.testing.assert_allclose(kept, repair.damping * wild)
    for more in (1.001, 1.01):
        assert jacobians(points, cells, more * kept).min() < FLOOR


def test_damping_finds_the_closed_form():
    """Mirrored in one axis, J is 1 - 2 s."""
    points, cells = box((4, 4, 4), (2, 2, 2))
    kept, factor = damped(points, cells, -2 * points * [0, 1, 0])
    assert factor == pytest.approx((1 - FLOOR) / 2, abs=1e-6)
    np.testing.assert_allclose(kept, -2 * factor * points * [0, 1, 0])


def test_a_repair_that_makes_it_worse_is_not_taken(bent, monkeypatch):
    points, cells, law, field, constrained = bent
    broken = through(points, cells, field, constrained_corners(cells, constrained, 0)[7])
    monkeypatch.setattr(
        "pinnochio.mechanics.solvers.inversion_repair._relaxed", lambda *args: RNG(0).normal(size=args[4].shape)
    )
    kept, repair = repair_inversions(points, cells, law, broken, constrained)
    assert repair.elements == 0 and repair.damping < 1
    np.testing.assert_allclose(kept, repair.damping * broken)


def test_the_inversion_repair_knows_no_chance(bent):
    points, cells, law, field, constrained = bent
    rough = field + 0.8 * RNG(5).normal(size=field.shape)
    first, second = (repair_inversions(points, cells, law, rough, constrained) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    assert first[1] == second[1]


def test_a_mesh_that_nothing_holds_is_mended_or_damped(bent):
    """Rings that reach every node of a mesh without interface leave a part that no solver holds."""
    points, cells, law, field, constrained = bent
    rough = field + 0.5 * RNG(1).normal(size=field.shape)
    kept, _ = repair_inversions(points, cells, law, rough, np.zeros(len(points), bool))
    assert jacobians(points, cells, kept).min() > 0
    points, cells = box((4, 4, 4), (1, 1, 1))
    collapsed = np.where(points == 0, 6.0, 0.0)
    kept, repair = repair_inversions(points, cells, uniform(6), collapsed, np.zeros(8, bool))
    assert repair.raw_inverted and repair.damping < 1 and jacobians(points, cells, kept).min() > 0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_field_that_is_none_is_refused(bent, value):
    points, cells, law, field, constrained = bent
    bad = field.copy()
    bad[3, 1] = value
    with pytest.raises(InputError, match="not finite"):
        repair_inversions(points, cells, law, bad, constrained)
    with pytest.raises(InputError, match="shape"):
        repair_inversions(points, cells, law, field[:-1], constrained)
