"""Newton corrections: from a field to the equilibrium on its interface, correction by correction."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.mechanics.elements.assembly import Assembler
from pinnochio.mechanics.elements.tetrahedra import Elements, jacobians, patch_bulk
from pinnochio.mechanics.problems import uniform
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.solvers.inversion_repair import FLOOR
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.mechanics.solvers.newton_corrections import EQUILIBRIUM, Corrector, Finish, expected_pressure, interface
from pinnochio.model.patient import FIXED, FREE, NO_INTERFACE
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import fem_settings
from tests.helpers.solids import bent_block

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def bent():
    """Mesh, law, prescribed nodes and motion, and equilibrium of a bent block."""
    points, cells, boundary = bent_block((12, 6, 5))
    law = uniform(len(cells))
    solution = solve(points, cells, law, boundary, fem_settings(tolerance=1e-10))
    assert solution.converged
    return points, cells, law, boundary.prescribed_nodes, boundary.displacement(1.0), solution.displacement


def rough(bent, noise, jump=0.0, seed=0):
    """The equilibrium with noise on the free nodes and with the prescribed ones moved off by `jump`, mm."""
    points, _, _, nodes, _, field = bent
    off = noise * RNG(seed).normal(size=points.shape)
    off[nodes] = jump * RNG(seed + 1).normal(size=(len(nodes), 3))
    return field + off


def newton_corrections(points, cells, law, nodes, motion, start, steps, volumetric="patch"):
    """The corrections of one plan."""
    corrector = Corrector(points, cells, law, nodes, volumetric)
    made = corrector.corrections(start, motion, steps)
    corrector.close()
    return made


@pytest.mark.parametrize("volumetric", ["patch", "p1"])
@pytest.mark.parametrize("seed", range(2))
def test_many_corrections_are_finite_elements_on_the_interface(bent, volumetric, seed):
    points, cells, law, nodes, motion, _ = bent
    boundary = bent_block((12, 6, 5))[2]
    wanted = solve(points, cells, law, boundary, fem_settings(volumetric=volumetric, tolerance=1e-11)).displacement
    start = rough(bent, 0.1, 0.1, seed)
    states = newton_corrections(points, cells, law, nodes, motion, start, 15, volumetric)
    assert states[-1].residual < 1e-9 and states[-1].gap == 0
    np.testing.assert_allclose(states[-1].displacement, wanted, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(states[-1].displacement[nodes], motion)


def test_no_correction_is_the_field_untouched(bent):
    points, cells, law, nodes, motion, _ = bent
    start = rough(bent, 0.1, 0.1)
    (only,) = newton_corrections(points, cells, law, nodes, motion, start, 0)
    np.testing.assert_array_equal(only.displacement, start)
    assert only.seconds == 0 and only.least == pytest.approx(jacobians(points, cells, start).min())
    assert only.gap == pytest.approx(np.linalg.norm(start[nodes] - motion, axis=1).max())


def test_the_first_correction_takes_the_interface_along_and_each_says_what_it_is(bent):
    points, cells, law, nodes, motion, _ = bent
    states = newton_corrections(points, cells, law, nodes, motion, rough(bent, 0.1, 0.1), 5)
    assert len(states) == 6 and states[1].share == 1 and states[1].gap == 0
    elements, free = Elements.build(points, cells, law), np.setdiff1d(np.arange(len(points)), nodes)
    for state in states:
        force = elements.evaluate(state.displacement)[1]
        assert state.residual == pytest.approx(np.linalg.norm(force[free]) / np.linalg.norm(force[nodes]))
        assert state.least == pytest.approx(jacobians(points, cells, state.displacement).min())
    residuals, seconds = [state.residual for state in states], [state.seconds for state in states]
    assert residuals[-1] < 1e-6 * residuals[0] and (np.diff(seconds) > 0).all()
    _, far = newton_corrections(points, cells, law, nodes, motion, -0.1 * bent[-1], 1)
    assert far.share == 1 and far.gap == 0  # to the last bit
    assert residuals[5] < 1e-2 * residuals[4] < 1e-4 * residuals[3]  # quadratic at the end


def test_carried_pressure_needs_fewer_corrections_than_newton_and_no_cut_tangent(bent, monkeypatch):
    """Nearly incompressible: the tangent of a rough field is indefinite, that with the carried pressure is not."""
    points, cells, _, nodes, motion, _ = bent
    law = uniform(len(cells), poisson=0.499)
    start = rough(bent, 0.05)
    corrector = Corrector(points, cells, law, nodes)
    newton, pressures, cut = corrector._newton, [], []
    predict = newton.predict

    def watched(state, end, pressure=None, cut_below=0.0):
        direction = predict(state, end, pressure, cut_below)
        pressures.append(pressure)
        cut.append(direction.cut)
        return direction

    monkeypatch.setattr(newton, "predict", watched)
    carried = corrector.corrections(start, motion, 4)
    assert len(cut) == 4 and not cut[-1]
    state = newton.measured(start, 1.0)
    for _ in range(4):
        state = newton.measured(state.u + newton.predict(state, 1.0).motion, 1.0)
    assert cut[4] and carried[-1].residual < 0.1 * state.residual
    one = corrector.corrections(start, motion, 2)[1].displacement  # the second stands on what the first expected
    np.testing.assert_allclose(pressures[-1], expected_pressure(newton.elements, start, one - start), rtol=1e-9)
    corrector.close()


def test_a_tangent_with_the_pressure_of_its_field_is_the_tangent(bent):
    points, cells, law, nodes, _, field = bent
    elements, constrained = Elements.build(points, cells, law), np.zeros(points.shape, bool)
    constrained[nodes] = True
    assembler, frames = Assembler(elements, constrained, []), np.zeros((0, 3, 3))
    u = field + 0.1 * RNG(0).normal(size=field.shape)
    expected = expected_pressure(elements, u, np.zeros_like(u))
    plain, same, none = (assembler.tangent(u, frames, pressure=p)[0] for p in (None, expected, 0 * expected))
    np.testing.assert_allclose(same, plain, rtol=1e-12, atol=1e-9)
    assert np.abs(none - plain).max() > 1e-2 * np.abs(plain).max()


@pytest.mark.parametrize("seed", range(3))
def test_expected_pressure_is_the_first_order(bent, seed):
    points, cells, law, _, _, field = bent
    elements = Elements.build(points, cells, law)
    change = RNG(seed).normal(size=field.shape)

    def pressure(u):
        first, second = (np.zeros(len(elements.patch_volumes)) for _ in range(2))
        patch_bulk(u, elements.arrays, first, second)
        return first

    h = 1e-6
    slope = (pressure(field + h * change) - pressure(field - h * change)) / (2 * h)
    rate = expected_pressure(elements, field, change) - pressure(field)
    np.testing.assert_allclose(rate, slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


def test_no_correction_turns_an_element_inside_out_on_an_interface_that_would(bent):
    """The interface moves four nodes of one element through each other: it is met but there."""
    points, cells, law, nodes, motion, field = bent
    constrained = np.isin(np.arange(len(points)), nodes)
    cell = cells[constrained[cells].sum(axis=1) == 3][2]
    wild, place = motion.copy(), np.flatnonzero(np.isin(nodes, cell))[0]
    wild[place] += 12 * np.array([np.sign(20 - points[nodes[place], 0]), 0, 0])  # deep into the block
    moved = field.copy()
    moved[nodes] = wild
    assert jacobians(points, cells, moved).min() < 0
    states = newton_corrections(points, cells, law, nodes, wild, field, 25)
    assert all(state.least > 0 for state in states)
    last = states[-1].displacement
    assert states[-1].gap < 1e-9 and states[-1].residual < 1e-6
    met = np.linalg.norm(last[nodes] - wild, axis=1) < 1e-9
    assert met.mean() > 0.8 and states[-1].least > FLOOR / 2


def test_plans_do_not_know_of_each_other(bent):
    points, cells, law, nodes, motion, _ = bent
    starts = [rough(bent, 0.02, 0.01, seed) for seed in (0, 5)]  # alike: the factors of one would do for the other
    corrector = Corrector(points, cells, law, nodes)
    both = [corrector.corrections(start, motion, 1)[-1].displacement for start in starts]
    corrector.close()
    for start, together in zip(starts, both, strict=True):
        alone = newton_corrections(points, cells, law, nodes, motion, start, 1)[-1].displacement
        np.testing.assert_array_equal(together, alone)


def test_another_field_of_the_same_plan_takes_the_factors_of_the_one_before(bent):
    points, cells, law, nodes, motion, _ = bent
    corrector = Corrector(points, cells, law, nodes)
    corrector.corrections(rough(bent, 0.02, 0.01, 0), motion, 1)
    made = corrector._newton.factorizations
    start = rough(bent, 0.02, 0.01, 5)
    kept = corrector.corrections(start, motion, 1, alike=True)[-1].displacement
    assert corrector._newton.factorizations == made
    corrector.close()
    fresh = newton_corrections(points, cells, law, nodes, motion, start, 1)[-1].displacement
    assert np.abs(kept - fresh).max() < 5e-2 * np.abs(fresh - start).max()


def test_corrections_end_where_the_tolerance_is_met_or_nothing_is_left_to_gain(bent):
    points, cells, law, nodes, motion, field = bent
    corrector = Corrector(points, cells, law, nodes)
    states = corrector.corrections(rough(bent, 0.05, 0.05), motion, 20, 1e-6)
    assert states[-1].residual <= 1e-6 < states[-2].residual and len(states) < 9
    assert len(corrector.corrections(field, motion, 20, 1e-6)) == 1
    # In equilibrium, but with another interface than it is asked for.
    states = corrector.corrections(field, motion + [0, 0, 10 * np.pi], 20, 1e-6)
    assert len(states) > 1 and states[-1].residual <= 1e-6 and all(state.gap == 0 for state in states[1:])
    np.testing.assert_allclose(states[-1].displacement, field + [0, 0, 10 * np.pi], atol=1e-4)
    corrector.close()


def test_what_does_not_fit_is_refused(bent):
    points, cells, law, nodes, motion, field = bent
    corrector = Corrector(points, cells, law, nodes)
    with pytest.raises(InputError, match="do not fit"):
        corrector.corrections(field[:-1], motion, 1)
    with pytest.raises(InputError, match="do not fit"):
        corrector.corrections(field, motion[:-1], 1)
    with pytest.raises(InputError, match="not finite"):
        corrector.corrections(field * np.nan, motion, 1)
    corrector.close()


@pytest.fixture(scope="module")
def patient():
    """A tiny patient, its law and the equilibrium under its plan with sliding nodes."""
    model, fem = tiny_patient(), fem_settings()
    return model, fem, simulate(model, [tiny_plan()], fem)[0].displacement


def test_interface_nodes_are_prescribed_and_cut_planes_rest(patient):
    model, _, field = patient
    nodes, prescribed = interface(model, field + 1.0)
    np.testing.assert_array_equal(nodes, np.flatnonzero(model.node_type != FREE))
    cut = ((model.node_type == FIXED) & (model.interface_kind == NO_INTERFACE))[nodes]
    assert cut.any() and not prescribed[cut].any()
    np.testing.assert_array_equal(prescribed[~cut], (field + 1.0)[nodes[~cut]])


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_finish_repairs_and_corrects_a_networks_field(patient, steps):
    model, fem, field = patient
    off = field + 0.02 * RNG(0).normal(size=field.shape)
    boundary = np.where((model.node_type != FREE)[:, None], field, 0)
    free = np.flatnonzero((model.node_type == FREE) & ~np.isin(np.arange(len(off)), model.skin_faces))
    off[free[0]] += [0, 0, 9]  # a node through its neighbours
    assert jacobians(model.points, model.cells, off).min() < 0
    finish = Finish(model, fem, steps)
    for _ in range(2):
        field_out, repair, made = finish(off, boundary)
        assert repair.raw_inverted > 0 < repair.elements
        assert made == steps or 1 <= made < steps == 4  # EQUILIBRIUM is met
        assert jacobians(model.points, model.cells, field_out).min() > 0
        away = np.linalg.norm(field_out - field, axis=1).max()
        assert (away < 0.02) == (steps == 4)
    states, _ = finish.all(off, boundary)
    residuals = [state.residual for state in states]
    assert len(states) == steps + 1 or residuals[-1] <= EQUILIBRIUM
    assert steps < 4 or residuals[0] > EQUILIBRIUM >= residuals[-1]
