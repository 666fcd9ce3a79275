"""The stability sweep: its problems are what they say, and its judges call a corrupted result wrong."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pinnochio.columns import read_table, write_csv
from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, Elements, jacobians
from pinnochio.mechanics.solvers.inversion_repair import repair_inversions
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.mechanics.solvers.newton_corrections import Corrector
from pinnochio.metrics.validity import off_bone
from pinnochio.model.predictions import Prediction
from pinnochio.tables.formats import write_table
from studies.stability import problems
from studies.stability.check_stability import check_stability
from studies.stability.figure import draw
from studies.stability.inputs import parts
from studies.stability.judging import (
    Balance,
    judge_correction,
    judge_elastic,
    judge_network,
    judge_repair,
    judge_solution,
)
from studies.stability.measure_stability import stability
from studies.stability.sweep import Sweep, attempt
from studies.stability.table import CLEAN, CONVERGED, OF_PATIENTS, OUTCOMES, STABILITY, WRONG, table, tabulate
from tests.helpers.patients import tiny_patient
from tests.helpers.settings import CONFIG, fem_settings

STEPS = (6, 4, 4)
FEM = fem_settings(time_limit=60)
PATIENT = tiny_patient()
SETTINGS = {"block": STEPS, "roughness": 0.3}
LABELS = {"seed": 1, "device": "cpu", "code": "abc"}


def solved(problem, element):
    return solve(problem.points, problem.cells, problem.material, problem.boundary, fem_settings(volumetric=element))


def elastic(problem, element):
    solver = ElasticSolver(problem.points, problem.cells, problem.material, problem.boundary, element)
    return solver.solve(problem.boundary)


def sweep(family, *values, way="-", **settings) -> Sweep:
    moved = family in OF_PATIENTS
    return Sweep(
        family=family,
        case="tiny" if moved else "block",
        way=way,
        model=PATIENT if moved else None,
        config=SETTINGS | {family: values} | settings,
        fem=FEM,
        seed=1,
    )


def framed(rows) -> pd.DataFrame:
    return pd.DataFrame([row | LABELS for row in rows])


@pytest.fixture(scope="module")
def block():
    return problems.block(STEPS)


@pytest.fixture(scope="module", params=VOLUMETRIC)
def solution(request, block):
    return request.param, solved(block, request.param)


@pytest.fixture(scope="module")
def sliding():
    """A patient with sliding nodes, moved by 2 mm, and its solution."""
    problem = problems.movement(PATIENT, problems.moved(PATIENT, "left", "forward", 2.0), FEM)
    assert len(problem.boundary.sliding[0].nodes)
    return problem, solved(problem, VOLUMETRIC[0])


# ---- problems


@pytest.mark.parametrize("dihedral", [15, 1, 0.1])
def test_sliver_mesh_has_the_wished_angle(dihedral):
    problem = problems.block(STEPS, dihedral=dihedral)
    assert problems.smallest_dihedral(problem.points, problem.cells) == pytest.approx(dihedral, rel=1e-6)
    assert (jacobians(problem.points, problem.cells, np.zeros_like(problem.points)) > 0).all()


def test_a_block_without_interior_nodes_is_refused():
    with pytest.raises(InputError, match="no interior node"):
        problems.block((4, 4, 1), dihedral=5)


@pytest.mark.parametrize("share", [0, 0.1, 0.25, 0.5])
def test_start_is_inverted_as_far_as_wished(block, share):
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
        problems.moved(tiny_patient(), "jaw", "pitch", 10)


def test_segments_move_as_wished():
    back = problems.moved(PATIENT, "left", "back", 3.0)
    bone = PATIENT.bone_points[PATIENT.bone_segment == 0]
    assert np.allclose(back.motion("left").displacement(bone), [0, 3, 0])
    turned = problems.moved(PATIENT, "left", "yaw", 30.0).motion("left")
    assert np.allclose(turned.degrees, [0, 0, 30]) and np.allclose(turned.apply(bone).mean(axis=0), bone.mean(axis=0))
    rough = problems.roughened(PATIENT, 0.5, np.random.default_rng(0))
    way = ((rough.bone_points - PATIENT.bone_points) * PATIENT.bone_normals).sum(axis=1)
    assert way.std() == pytest.approx(0.5, rel=0.15)
    assert np.allclose(np.linalg.norm(rough.bone_normals, axis=1), 1)
    turned = (rough.bone_normals * PATIENT.bone_normals).sum(axis=1)
    assert turned.min() < 0.99 and turned.min() > 0
    assert [np.prod(np.add(problems.steps_of(count), 1)) / count for count in (1500, 50000)] == pytest.approx(
        [1, 1], abs=0.35
    )


# ---- the judge's own forces


@pytest.mark.parametrize("element", VOLUMETRIC)
def test_the_judge_finds_the_force_that_two_other_assemblies_find(block, element):
    rng = np.random.default_rng(2)
    law = replace(block.material, stiffening=np.full(len(block.cells), 0.7), extension=0.1)
    elements = Elements.build(block.points, block.cells, law, element)
    balance = Balance.of(replace(block, material=law), element)
    for size in (0.3, 4.0):  # the second turns elements inside out
        u = rng.normal(0, size, block.points.shape)
        force = elements.evaluate(u)[1]
        assert np.abs(balance.force(u) - force).max() < 1e-12 * np.abs(force).max()
        assert np.allclose(balance.ratios(u), jacobians(block.points, block.cells, u))
    assert (balance.ratios(u) < 0).any()
    tiny = 1e-7 * u
    assert np.abs(balance.linear(tiny) - balance.force(tiny)).max() < 1e-5 * np.abs(balance.linear(tiny)).max()
    assert not balance.no_patches()


def test_what_is_no_patch_is_seen(block):
    patches = Balance.of(block, "patch").patches
    one = np.flatnonzero(patches == 0)
    torn = patches.copy()
    torn[one[0]] = patches[-1]
    assert "pieces" in Balance(block.points, block.cells, block.material, torn).no_patches()[0]
    whole = np.zeros(len(patches), int)
    assert "too large" in Balance(block.points, block.cells, block.material, whole).no_patches()[0]
    law = replace(block.material, lam=np.where(np.arange(len(patches)) == one[0], 1.0, 2.0) * block.material.lam)
    assert "several tissues" in Balance(block.points, block.cells, law, patches).no_patches()[0]


def test_tissue_that_has_left_its_bone_is_seen_and_marked(sliding):
    problem, result = sliding
    assert off_bone(PATIENT, problem.plan, result.displacement).max() < 0.5
    far = problems.moved(PATIENT, "left", "left", 60.0)
    carried = np.tile([60.0, 0, 0], (len(PATIENT.points), 1))
    assert off_bone(PATIENT, far, carried).max() < 1e-9  # with its bone
    # The bone has gone from under the nodes: they keep to the plane that goes on beyond its rim.
    assert off_bone(PATIENT, far, np.zeros_like(carried)).max() > 20
    verdict = judge_solution(replace(problem, plan=far), VOLUMETRIC[0], result, 1.0, fem_settings())
    assert verdict.outcome == WRONG and verdict.marked and "left its bone" in verdict.reason
    moved = result.displacement.copy()
    moved[problem.free[0]] += 1e-3
    verdict = judge_solution(
        replace(problem, plan=far), VOLUMETRIC[0], replace(result, displacement=moved), 1.0, fem_settings()
    )
    assert verdict.outcome == WRONG and not verdict.marked  # of the other fault nothing warns


def test_a_repair_is_judged_by_what_it_leaves_and_says(block):
    rng = np.random.default_rng(4)
    raw = problems.tangled(block, np.zeros_like(block.points), 0.1, rng)
    interface = np.ones(len(raw), bool)
    interface[block.free] = False
    field, repair = repair_inversions(block.points, block.cells, block.material, raw, interface)
    assert judge_repair(block, raw, field, repair).outcome == CONVERGED
    assert "inside out" in judge_repair(block, raw, raw, repair).reason
    assert "inverted before" in judge_repair(block, raw, field, replace(repair, raw_inverted=1)).reason
    pushed = field.copy()
    pushed[np.flatnonzero(interface)[0]] += 1e-3
    assert "interface" in judge_repair(block, raw, pushed, repair).reason
    damped = judge_repair(block, raw, field, replace(repair, damping=0.5))
    assert damped.outcome == CLEAN and "50 %" in damped.reason

    nodes = block.boundary.prescribed_nodes
    corrector = Corrector(block.points, block.cells, block.material, nodes)
    made = corrector.corrections(field, field[nodes], 8, 1e-6)
    corrector.close()

    def outcome(last, of=repair):
        return judge_correction(block, "patch", [*made[:-1], last], nodes, field[nodes], of, 1e-6)

    assert outcome(made[-1]).outcome == CONVERGED
    assert outcome(made[-1], replace(repair, damping=0.5)).outcome == CLEAN
    assert outcome(made[1]).outcome == CLEAN and "corrections" in outcome(made[1]).reason
    assert "residual is said" in outcome(replace(made[1], residual=1e-7)).reason
    assert "least J is said" in outcome(replace(made[-1], least=0.9)).reason


def test_a_network_is_judged_by_elements_bone_and_forces(sliding):
    problem, result = sliding
    made = Prediction(result.displacement, iterations=4, repaired=0, damping=1.0)

    def judged(index=None, way=(0.0, 0.0, 0.0), **changes):
        field = result.displacement.copy()
        field[index] += way
        return judge_network(problem, VOLUMETRIC[0], replace(made, displacement=field, **changes), FEM)

    assert judged([0]).outcome == CONVERGED and "4 corrections" in judged([0]).reason
    free, held = problem.free[len(problem.free) // 2], problem.boundary.prescribed_nodes[0]
    assert judged([free], (0.3, 0.0, 0.0)).outcome == CLEAN
    assert judged([0], damping=0.5).outcome == CLEAN
    load = np.zeros_like(result.displacement)
    load[free] = 1e6
    assert judged([0], forces=load).outcome == CLEAN  # is not in balance with what it says
    torn = judged([held], (0.0, 0.0, 3.5))
    assert torn.outcome == WRONG and torn.marked and "attached tissue is 3.5 mm" in torn.reason
    through = judged([free], (0.0, 0.0, 60.0))
    assert through.outcome == WRONG and through.marked and "least J" in through.reason


# ---- judges: the truth passes, a corrupted result does not


def test_solution_is_confirmed_and_lies_are_not(block, solution):
    element, result = solution
    options = fem_settings(volumetric=element)

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


def test_a_known_field_must_be_met_where_it_is_the_only_one(block, solution):
    element, result = solution
    options, known = fem_settings(volumetric=element), result.displacement + 2e-3
    assert judge_solution(block, element, result, 1.0, options, result.displacement + 1e-4).outcome == CONVERGED
    assert judge_solution(block, element, result, 1.0, options, known).outcome == WRONG
    several = judge_solution(block, element, result, 1.0, options, known, unique=False)
    assert several.outcome == CONVERGED and "another equilibrium" in several.reason


def test_stopping_is_clean_with_a_reason_in_time(block, solution):
    element, result = solution
    options = fem_settings(volumetric=element, time_limit=60)

    def outcome(reason, seconds):
        return judge_solution(block, element, replace(result, converged=False, reason=reason), seconds, options).outcome

    assert outcome("line search stagnated", 50) == CLEAN
    assert outcome("", 50) == WRONG
    assert outcome("time limit", 90) == WRONG


def test_sliding_nodes_are_kept_on_their_surface_and_free_along_it(sliding):
    problem, result = sliding
    element, options = VOLUMETRIC[0], fem_settings()
    assert judge_solution(problem, element, result, 1.0, options).outcome == CONVERGED
    node = problem.boundary.sliding[0].nodes[0]
    for way, what in (([0, 0, 1e-4], "sliding nodes"), ([0.05, 0, 0], "residual")):
        moved = result.displacement.copy()
        moved[node] += way
        judgement = judge_solution(problem, element, replace(result, displacement=moved), 1.0, options)
        assert judgement.outcome == WRONG and what in judgement.reason
    # Nodes that stick to their bone keep their distance to it, and all but they are in equilibrium.
    motion = problem.boundary.sliding[0].motion
    slide = problem.boundary.sliding[0].nodes
    nodes = np.concatenate([problem.boundary.prescribed_nodes, slide])

    def stuck(fraction):
        return np.vstack(
            [problem.boundary.displacement(fraction), motion(fraction).displacement(problem.points[slide])]
        )

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


def test_only_a_refusal_in_words_is_a_clean_failure():
    def fails(error):
        def compute():
            raise error

        return attempt(compute, None)[1]

    assert fails(InputError("-", "mesh", "flat", "mend it")).outcome == CLEAN
    assert fails(RuntimeError("not positive definite")).outcome == CLEAN
    for error in (RuntimeError(), NotImplementedError("later"), IndexError("5"), ValueError("x"), ZeroDivisionError()):
        assert fails(error).outcome == WRONG and type(error).__name__ in fails(error).reason


def test_no_start_leads_to_a_solution_with_elements_inside_out():
    """The extended law has an equilibrium there; it was called converged."""
    patient = tiny_patient(shape=(13, 9, 7), edge=2.5)
    problem = problems.movement(patient, problems.moved(patient, "left", "forward", 2.0), FEM)
    start, options = elastic(problem, "patch"), fem_settings(restart=False)
    result = solve(problem.points, problem.cells, problem.material, problem.boundary, options, start)
    assert result.min_jacobian < 0 and result.residual < 1e-6
    assert not result.converged and "inside out" in result.reason
    assert judge_solution(problem, "patch", result, 1.0, options).outcome == CLEAN
    lie = replace(result, converged=True)
    assert "least J" in judge_solution(problem, "patch", lie, 1.0, options).reason


# ---- the sweep


def test_every_method_moves_a_patient_and_is_confirmed():
    rows = pd.DataFrame(sweep("translation", 2.0, way="forward").rows())
    assert not rows.duplicated(["family", "setting", "segment", "method", "element", "precision"]).any()
    assert (rows["outcome"] == CONVERGED).all(), rows[rows["outcome"] != CONVERGED].to_string()
    assert set(rows["method"]) == {"elastic", "solver", "kept", "map", "bonded"}
    assert (
        set(rows["segment"]) == {"left", "both jaws"}
        and set(rows["case"]) == {"tiny"}
        and set(rows["way"]) == {"forward"}
    )
    turned = pd.DataFrame(sweep("rotation", 5.0, way="yaw").rows())
    assert 2 * len(turned) == len(rows) and not (turned["outcome"] == WRONG).any()


def test_rough_bone_is_judged():
    rough = pd.DataFrame(sweep("rough", 1.0, way="back").rows())
    assert set(rough["method"]) == {"elastic", "solver", "kept", "map"}
    assert not (rough["outcome"] == WRONG).any() and set(rough["segment"]) == {"left"}


def test_every_method_on_the_block_is_confirmed():
    for family, value, count in (("unit", 1000.0, 10), ("inverted", 25.0, 12), ("size", 300, 3)):
        rows = pd.DataFrame(sweep(family, value).rows())
        assert len(rows) == count, rows.to_string()
        assert not (rows["outcome"] == WRONG).any(), rows.to_string()
        assert (rows.loc[rows["method"].isin(["solver", "elastic"]), "outcome"] == CONVERGED).all()
        assert not rows.duplicated(["method", "element", "precision"]).any()


def test_a_wrong_cell_stands_in_the_table_and_fails_the_check(tmp_path):
    part, path, verdict = tmp_path / "poisson.csv", tmp_path / "stability.csv", tmp_path / "verdict.txt"
    stability("poisson", "block", "-", None, SETTINGS | {"poisson": [0.3]}, FEM, 1, "abc", str(part))

    def check(frame):
        write_csv(frame, part, STABILITY)
        made = tabulate([part])
        write_table(made, path)
        check_stability(str(path), str(verdict))
        return made

    rows = read_table(part, STABILITY)
    made = check(rows)
    assert verdict.read_text().startswith("10 cells: 10 converged, 0 failed cleanly, 0 wrong")
    assert len(read_table(path, STABILITY)) == 10 and not made.paragraphs
    lie = rows.copy()
    lie.loc[3, ["outcome", "reason"]] = [WRONG, "the sign of everything"]
    with pytest.raises(RuntimeError, match="1 of 10 cells are wrong.*\n.*poisson 0.3.*the sign of everything"):
        check(lie)
    assert (read_table(path, STABILITY)["outcome"] == WRONG).sum() == 1
    assert "the sign of everything" in path.with_suffix(".md").read_text()
    # What no user is given stands in the table and passes.
    lie.loc[3, "marked"] = True
    assert "1 of them no user" in check(lie).paragraphs[0]


def test_the_envelope_ends_before_the_first_failure():
    good = next(iter(sweep("poisson", 0.3).rows()))
    cells = [(5, "back", CONVERGED), (5, "up", CONVERGED), (15, "back", CLEAN), (15, "up", CONVERGED)]
    cells.append((25, "up", CONVERGED))
    assert reach(good, cells) == ("5 mm", "15 mm: 1 of 2")
    # An element inside out ends it too.
    assert reach(good | {"min_jacobian": -0.1}, cells) == ("none", "5 mm: 0 of 2")


def reach(good, cells):
    """What the envelope says of some cells of one method."""
    moves = [
        good | {"family": "translation", "unit": "mm", "setting": float(far), "way": way, "outcome": outcome}
        for far, way, outcome in cells
    ]
    blocks = table(framed(moves)).blocks
    row = dict(zip(blocks[1].headers, [text for text, _ in blocks[1].rows[0]], strict=True))
    return row["All is well up to"], row["Beyond"]


def test_picture_shows_every_outcome(tmp_path):
    frame = framed(sweep("poisson", 0.3).rows())
    frame.loc[: len(OUTCOMES) - 1, "outcome"] = OUTCOMES
    frame.loc[1, ["min_jacobian", "residual"]] = np.nan
    draw(frame, [tmp_path / "stability.png"])
    assert (tmp_path / "stability.png").stat().st_size > 10_000


def test_the_sweep_is_a_job_per_family_case_and_way():
    section = CONFIG["stability"] | {"patients": 1, "directions": ["back"], "axes": ["yaw"], "unit": []}
    made = parts(section, ["P1", "P2"])
    moved = ["translation_P1_back", "rotation_P1_yaw", "rough_P1_back"]
    assert list(made) == [*moved, "poisson", "stiffness", "dihedral", "inverted", "size"]
    assert made[moved[1]] == {"family": "rotation", "case": "P1", "way": "yaw"}
