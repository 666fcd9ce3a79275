"""The stability sweep: its problems are what they say, and its judges call a corrupted result wrong."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from pinnochio.columns import read_table
from pinnochio.errors import InputError
from pinnochio.experiments import stability_problems as problems
from pinnochio.experiments.stability import Sweep, attempt
from pinnochio.experiments.stability_judge import judge_elastic, judge_loss, judge_solution, slope_of
from pinnochio.figures.stability import draw
from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.elements import VOLUMETRIC, jacobians
from pinnochio.mechanics.sliding import BoundaryConditions
from pinnochio.mechanics.solver import solve
from pinnochio.methods.pinnochio.patient import LOSS_EXTENSION
from pinnochio.tables.stability import CLEAN, CONVERGED, FAMILIES, OUTCOMES, STABILITY, WRONG, table
from scripts.stability import training_loss
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import fem_settings, solver_options
from tests.helpers.tables import write

STEPS = (6, 4, 4)
FEM = fem_settings(time_limit=60)
NOTHING = dict.fromkeys(FAMILIES, ()) | {"segment": "left", "block": STEPS, "noise": 0.1}


def solved(problem, element):
    return solve(problem.points, problem.cells, problem.material, problem.boundary, solver_options(volumetric=element))


def elastic(problem, element):
    solver = ElasticSolver(problem.points, problem.cells, problem.material, problem.boundary, element)
    return solver.solve(problem.boundary)


def sweep(**families) -> Sweep:
    return Sweep("tiny", tiny_patient(), NOTHING | families, FEM, LOSS_EXTENSION, training_loss, 1)


@pytest.fixture(scope="module")
def block():
    return problems.block(STEPS)


@pytest.fixture(scope="module", params=VOLUMETRIC)
def solution(request, block):
    return request.param, solved(block, request.param)


@pytest.fixture(scope="module")
def sliding():
    """A patient with sliding nodes, moved by 2 mm, and its solution."""
    problem = problems.movement(tiny_patient(), "left", problems.forward(2.0), FEM, "float64")
    assert len(problem.boundary.sliding[0].nodes)
    return problem, solved(problem, VOLUMETRIC[0])


# ---- problems


@pytest.mark.parametrize("dihedral", [15, 1, 0.1])
def test_sliver_mesh_has_the_angle_asked_for(dihedral):
    problem = problems.block(STEPS, dihedral=dihedral)
    assert problems.smallest_dihedral(problem.points, problem.cells) == pytest.approx(dihedral, rel=1e-6)
    assert (jacobians(problem.points, problem.cells, np.zeros_like(problem.points)) > 0).all()


def test_a_block_without_interior_nodes_is_refused():
    with pytest.raises(InputError, match="no interior node"):
        problems.block((4, 4, 1), dihedral=5)


@pytest.mark.parametrize("share", [0, 0.1, 0.25, 0.5])
def test_start_is_inverted_as_far_as_asked(block, share):
    start = problems.tangled(block, np.zeros_like(block.points), share, np.random.default_rng(0))
    inverted = (jacobians(block.points, block.cells, start) <= 0).mean()
    assert share - 0.02 < inverted <= share
    assert share or np.abs(start).max() > 1
    assert (start[block.boundary.prescribed_nodes] == 0).all()


def test_settings_change_what_they_name():
    stiff = problems.block(STEPS, stiffness=1e4)
    assert stiff.material.mu.max() / stiff.material.mu.min() == pytest.approx(1e4)
    upper = stiff.points[stiff.cells].mean(axis=1)[:, 2] > 15
    assert stiff.material.mu[upper].min() > stiff.material.mu[~upper].max()
    metres = problems.block(STEPS, millimetres=1000)
    assert np.ptp(metres.points[:, 0]) == pytest.approx(0.08)
    assert metres.boundary.displacement(1.0).max() == pytest.approx(
        problems.block(STEPS).boundary.displacement(1.0).max() / 1000
    )
    assert problems.block(STEPS, "float32").points.dtype == np.float32
    with pytest.raises(InputError, match="no segment"):
        problems.pitch(tiny_patient(), "jaw", 10)


# ---- judges: the truth passes, a corrupted result does not


def test_solution_is_confirmed_and_lies_are_not(block, solution):
    element, result = solution
    options = solver_options(volumetric=element)

    def verdict(**claims):
        return judge_solution(block, element, replace(result, **claims), 1.0, options)

    assert verdict().outcome == CONVERGED and verdict().residual == pytest.approx(result.residual, rel=1e-3)
    node, prescribed = block.free[len(block.free) // 2], block.boundary.prescribed_nodes[0]
    for index, what in (((node, 0), "residual"), ((prescribed, 2), "prescribed")):
        moved = result.displacement.copy()
        moved[index] += 1e-3
        judgement = verdict(displacement=moved)
        assert judgement.outcome == WRONG and what in judgement.reason
    through = result.displacement.copy()
    through[node] += [0, 0, 60]
    assert "least J" in verdict(displacement=through).reason
    lost = result.displacement.copy()
    lost[node] = np.nan
    for converged in (True, False):
        assert verdict(displacement=lost, converged=converged).outcome == WRONG


def test_the_other_elements_equilibrium_is_no_equilibrium(block, solution):
    element, result = solution
    other = next(name for name in VOLUMETRIC if name != element)
    assert judge_solution(block, other, result, 1.0, solver_options()).outcome == WRONG


def test_a_known_field_must_be_met_where_it_is_the_only_one(block, solution):
    element, result = solution
    options, known = solver_options(volumetric=element), result.displacement + 2e-3
    assert judge_solution(block, element, result, 1.0, options, result.displacement + 1e-4).outcome == CONVERGED
    assert judge_solution(block, element, result, 1.0, options, known).outcome == WRONG
    several = judge_solution(block, element, result, 1.0, options, known, unique=False)
    assert several.outcome == CONVERGED and "another equilibrium" in several.reason


def test_stopping_is_clean_with_a_reason_in_time(block, solution):
    element, result = solution
    options = solver_options(volumetric=element, time_limit=60)

    def outcome(reason, seconds):
        return judge_solution(block, element, replace(result, converged=False, reason=reason), seconds, options).outcome

    assert outcome("line search stagnated", 50) == CLEAN
    assert outcome("", 50) == WRONG
    assert outcome("time limit", 90) == WRONG


def test_sliding_nodes_are_kept_on_their_surface_and_free_along_it(sliding):
    problem, result = sliding
    element, options = VOLUMETRIC[0], solver_options()
    assert judge_solution(problem, element, result, 1.0, options).outcome == CONVERGED
    node = problem.boundary.sliding[0].nodes[0]
    for way, what in (([0, 0, 1e-4], "sliding nodes"), ([0.05, 0, 0], "residual")):
        moved = result.displacement.copy()
        moved[node] += way
        judgement = judge_solution(problem, element, replace(result, displacement=moved), 1.0, options)
        assert judgement.outcome == WRONG and what in judgement.reason
    # Nodes that stick to their bone keep their distance to it, and all but they are in equilibrium.
    motion = problem.boundary.sliding[0].motion
    own = problem.boundary.sliding[0].nodes
    nodes = np.concatenate([problem.boundary.prescribed_nodes, own])

    def stuck(fraction):
        return np.vstack([problem.boundary.displacement(fraction), motion(fraction).displacement(problem.points[own])])

    glued = solved(replace(problem, boundary=BoundaryConditions(nodes, stuck)), element)
    judgement = judge_solution(problem, element, glued, 1.0, options)
    assert glued.converged and judgement.outcome == WRONG and judgement.reason.startswith("residual")
    linear = elastic(problem, element)
    assert judge_elastic(problem, element, linear).outcome == CONVERGED
    linear[node, 2] += 1e-4
    assert "sliding nodes" in judge_elastic(problem, element, linear).reason


@pytest.mark.parametrize("element", VOLUMETRIC)
def test_elastic_field_is_confirmed_and_a_wrong_one_is_not(block, element):
    field = elastic(block, element)
    assert judge_elastic(block, element, field).outcome == CONVERGED
    assert judge_elastic(block, element, field, field + 2e-3).outcome == WRONG
    scaled = field.copy()
    scaled[block.free] *= 1 + 1e-6
    assert judge_elastic(block, element, scaled).outcome == WRONG
    stiffer = replace(block, material=replace(block.material, lam=1.001 * block.material.lam))
    assert judge_elastic(stiffer, element, field).outcome == WRONG
    field[block.free[0], 0] = np.inf
    assert judge_elastic(block, element, field).outcome == WRONG


@pytest.mark.parametrize("element", VOLUMETRIC)
@pytest.mark.parametrize("share", [None, 0.3])
def test_loss_is_confirmed_and_a_wrong_one_is_not(block, element, share):
    rng = np.random.default_rng(3)
    state = elastic(block, element)
    state = state + rng.normal(0, 0.1, state.shape) if share is None else problems.tangled(block, state, share, rng)
    state = state.astype(np.float32).astype(float)

    def slope(precision, loss=training_loss):
        return slope_of(block, element, precision, state, LOSS_EXTENSION, loss)

    def outcome(precision, value):
        judged = judge_loss(block, element, precision, state, value, exact, LOSS_EXTENSION, np.random.default_rng(5))
        return judged.outcome

    exact, single = slope("float64"), slope("float32")
    assert outcome("float64", exact) == outcome("float32", single) == CONVERGED
    assert single[0] != exact[0]
    for precision, (value, gradient), small in (("float64", exact, 1e-5), ("float32", single, 1e-3)):
        assert outcome(precision, (value * (1 + small), gradient)) == WRONG
        assert outcome(precision, (value, gradient * (1 + small))) == WRONG
        assert outcome(precision, (value, np.roll(gradient, 1, axis=0))) == WRONG
        assert outcome(precision, (np.nan, gradient)) == WRONG
        assert outcome(precision, (value, np.where(gradient == gradient.max(), np.nan, gradient))) == WRONG

    def detached(operator, free):
        """A gradient that misses part of the chain: through half of the nodes alone."""
        half = torch.zeros(len(state), 1, dtype=operator.volumes.dtype)
        half[::2] = 1
        return lambda u: training_loss(operator, free)(half * u + (1 - half) * u.detach())

    assert outcome("float64", slope("float64", detached)) == WRONG


def test_only_a_refusal_in_words_is_a_clean_failure():
    def fails(error):
        def compute():
            raise error

        return attempt(compute, None)[1]

    assert fails(InputError("-", "mesh", "flat", "mend it")).outcome == CLEAN
    assert fails(RuntimeError("not positive definite")).outcome == CLEAN
    for error in (RuntimeError(), NotImplementedError("later"), IndexError("5"), ValueError("x"), ZeroDivisionError()):
        assert fails(error).outcome == WRONG and type(error).__name__ in fails(error).reason


# ---- the sweep


def test_sweep_has_every_cell_and_they_are_confirmed():
    rows = list(sweep(translation=(3.0,), unit=(1000.0,), inverted=(25.0,)).rows())
    table = pd.DataFrame(rows)
    assert len(table) == 12 + 12 + 8
    assert set(table["element"]) == set(VOLUMETRIC) and set(table["precision"]) == {"float64", "float32"}
    assert not table.duplicated(["family", "setting", "method", "element", "precision"]).any()
    assert (table["outcome"] == CONVERGED).all(), table[table["outcome"] != CONVERGED].to_string()
    assert set(table.loc[table["family"] == "translation", "case"]) == {"tiny"}
    assert set(table.loc[table["family"] == "inverted", "method"]) == {"solver", "loss"}


def test_a_loss_that_breaks_is_a_wrong_cell():
    broken = sweep(poisson=(0.49,))
    broken.loss = lambda operator, free: lambda u: (u * float("nan")).sum()
    outcomes = pd.DataFrame(broken.rows()).groupby("method")["outcome"].unique()
    assert list(outcomes["loss"]) == [WRONG] and list(outcomes["solver"]) == [CONVERGED]


def test_a_wrong_cell_is_never_written(tmp_path):
    rows = [row | {"seed": 1, "device": "cpu", "code": "abc"} for row in sweep(poisson=(0.3,)).rows()]
    path = tmp_path / "stability.csv"
    lie = [dict(row) for row in rows]
    lie[3] |= {"outcome": WRONG, "reason": "the sign of everything"}
    with pytest.raises(RuntimeError, match="1 of 12 cells are wrong.*\n.*poisson 0.3.*the sign of everything"):
        write(table(lie), path)
    assert not list(tmp_path.iterdir())
    write(table(rows), path)
    cells = read_table(path, STABILITY)
    assert len(cells) == 12 and np.isfinite(cells[["min_jacobian", "residual", "setting"]]).all(None)
    assert all(path.with_suffix(suffix).stat().st_size > 100 for suffix in (".md", ".tex", ".html"))


def test_picture_shows_every_outcome(tmp_path):
    rows = [row | {"seed": 1, "device": "cpu", "code": "abc"} for row in sweep(poisson=(0.3,)).rows()]
    for row, outcome in zip(rows, OUTCOMES, strict=False):
        row["outcome"] = outcome
    rows[1] |= {"min_jacobian": np.nan, "residual": np.nan}
    draw(pd.DataFrame(rows), [tmp_path / "stability.png"])
    assert (tmp_path / "stability.png").stat().st_size > 10_000
