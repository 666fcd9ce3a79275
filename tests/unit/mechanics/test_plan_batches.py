"""Batches of plans: law, factors and hard patches against the compiled kernels, fields against the solver of one plan.

Torch on a CPU runs what a GPU runs, but for the kernels of Triton.
"""

import numpy as np
import pytest
import torch
from scipy import sparse

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.sliding import SlidingNodes
from pinnochio.mechanics.elements.assembly import Assembler
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.problems import BLOCK, block_boundary, box, uniform
from pinnochio.mechanics.simulation import Simulator, simulate
from pinnochio.mechanics.solvers import kept_factors
from pinnochio.mechanics.solvers.batched import batch_energy, batch_sliding, hard_patches, plan_batches
from pinnochio.mechanics.solvers.batched.batch_energy import BatchElements
from pinnochio.mechanics.solvers.batched.dissection import dissect
from pinnochio.mechanics.solvers.batched.fronts import Fronts
from pinnochio.mechanics.solvers.batched.plan_batches import BatchSolver
from pinnochio.mechanics.solvers.batched.sparse_rows import SparseRows
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.patients import slab_patient
from tests.helpers.settings import fem_settings
from tests.helpers.solids import bent_block, material


def adjacency(cells, count) -> sparse.csr_array:
    pairs = np.repeat(cells, 4, axis=1).ravel(), np.tile(cells, 4).ravel()
    return sparse.csr_array((np.ones(len(pairs[0])), pairs), (count, count))


def plans_of(boundary, shares) -> list[BoundaryConditions]:
    return [BoundaryConditions(boundary.prescribed_nodes, share * boundary.displacement(1.0)) for share in shares]


def state(elements, size=0.2):
    """Displacements of two plans, one of which turns elements inside out."""
    rng = np.random.default_rng(0)
    u = rng.normal(0, 1, (elements.nodes, 3, 2)) * [size, 10 * size]
    return u, torch.as_tensor(u)


def bent_tangents():
    """The two states of a bent block, its mesh with what a product with their tangents needs, and these assembled."""
    points, cells, _ = bent_block()
    elements = Elements.build(points, cells, material(len(cells)))
    u, fields = state(elements)
    mesh, law = BatchElements(elements, "cpu"), torch.full((2,), elements.material.extension, dtype=torch.float64)
    measured = mesh.measure(fields, law)
    whole = Assembler(elements, np.zeros((elements.nodes, 3), bool), np.zeros(0, int))
    tangents = [whole.symmetric(whole.tangent(u[:, :, plan], np.zeros((0, 3, 3)))[0]) for plan in range(2)]
    return u, mesh, mesh.curvature(fields, measured, law)[0], measured.second, tangents


def test_separators_leave_no_edge_between_their_sides():
    points, cells = box((40, 20, 15), (8, 5, 4), jitter=0.15)
    graph = adjacency(cells, len(points))
    levels = dissect(points, graph, leaf=20)
    owned = np.concatenate([level.pivots[level.pivots >= 0] for level in levels])
    assert np.array_equal(np.sort(owned), np.arange(len(points)))
    assert len(levels) > 3
    reached: list[set] = []
    for level in levels:
        below, reached = reached, []
        for pivots, beside, children in zip(level.pivots, level.beside, level.children, strict=True):
            inside = set(pivots[pivots >= 0]).union(*(below[child] for child in children if child >= 0))
            around = set(graph[sorted(inside)].indices) if inside else set()
            assert around - inside == set(beside[beside >= 0])
            reached.append(inside)


@pytest.mark.parametrize("leaf", [10, 1000])
def test_fronts_solve_what_they_are_factors_of(leaf, monkeypatch):
    monkeypatch.setattr("pinnochio.mechanics.solvers.batched.fronts.dissect", lambda *mesh: dissect(*mesh, leaf=leaf))
    points, cells = box((40, 20, 15), (7, 4, 3), jitter=0.15)
    elements = Elements.build(points, cells, material(len(cells)))
    free = np.flatnonzero(points[:, 0] > 0)
    places = (3 * free[:, None] + np.arange(3)).ravel()
    matrix = plan_batches._stiffness(elements, [], np.zeros((0, 3, 3)))[places][:, places]
    fronts = Fronts(points[free], sparse.bsr_array(matrix, blocksize=(3, 3)), "cpu", torch.float64)
    x = np.random.default_rng(0).normal(size=(len(free), 3, 2))
    answer = fronts.solve(torch.as_tensor((matrix @ x.reshape(-1, 2)).reshape(x.shape)))
    np.testing.assert_allclose(answer, x, rtol=0, atol=1e-9)


def test_fronts_refuse_what_is_not_positive_definite():
    points, cells = box((40, 20, 15), (3, 2, 2))
    free = np.arange(len(points))
    matrix = plan_batches._stiffness(Elements.build(points, cells, material(len(cells))), [], np.zeros((0, 3, 3)))
    shifted = sparse.bsr_array(matrix - 1e-2 * sparse.eye_array(len(free) * 3), blocksize=(3, 3))
    with pytest.raises(RuntimeError, match="positive definite"):
        Fronts(points, shifted, "cpu")


@pytest.mark.parametrize("extension", [0.05, 0.9])
def test_law_is_that_of_the_compiled_kernels(extension):
    points, cells, _ = bent_block()
    elements = Elements.build(points, cells, material(len(cells))).with_extension(extension)
    u, fields = state(elements)
    measured = BatchElements(elements, "cpu").measure(fields, torch.full((2,), extension, dtype=torch.float64))
    for plan in range(2):
        energy, force, ratio = elements.measure(u[:, :, plan])
        assert float(measured.energy[plan]) == pytest.approx(energy, rel=1e-12)
        np.testing.assert_allclose(measured.force[:, :, plan], force, rtol=0, atol=1e-11 * np.abs(force).max())
        np.testing.assert_allclose(measured.ratio[:, plan], ratio[:, 0], rtol=0, atol=1e-12 * np.abs(ratio).max())
        np.testing.assert_allclose(measured.stretch[:, plan], ratio[:, 1], rtol=1e-12)
    assert measured.ratio[:, 1].min() < 0


def test_product_is_that_with_the_assembled_tangent():
    u, mesh, kept, second, tangents = bent_tangents()
    step = np.random.default_rng(1).normal(size=u.shape)
    product = mesh.product(kept, second, torch.as_tensor(step))
    for plan in range(2):
        exact = tangents[plan] @ step[:, :, plan].ravel()
        np.testing.assert_allclose(product[:, :, plan].ravel(), exact, rtol=0, atol=1e-10 * np.abs(exact).max())


def test_a_damped_tangent_bends_nowhere_downwards():
    _, mesh, kept, second, tangents = bent_tangents()
    values, directions = np.linalg.eigh(tangents[1].toarray())
    assert values[0] < 0
    damped, second = batch_energy.damped(kept, second)
    for direction in directions.T[::20]:
        step = torch.as_tensor(direction.reshape(-1, 3, 1)).expand(-1, -1, 2)
        bends = (step * mesh.product(damped, second, step)).sum((0, 1))
        assert (bends >= -1e-9 * abs(values[-1])).all()


def bent_zone(kind=hard_patches.HardPatches, device="cpu") -> tuple:
    """A bent block, and the hard patches of two plans of it."""
    points, cells, boundary = bent_block()
    elements = Elements.build(points, cells, material(len(cells)))
    elements = plan_batches._renumbered(elements, np.arange(len(points)))
    free = np.ones(len(points), bool)
    free[boundary.prescribed_nodes] = False
    return elements, kind(elements, free, 2, device)


def test_hard_patches_come_to_equilibrium_while_the_rest_stays():
    elements, part = bent_zone()
    known = torch.zeros(len(elements.patch_volumes), 2, dtype=torch.bool)
    known[3:6, 0] = True
    moves, touched = part.around(known)
    part.prepare(known)
    u = state(elements, 0.1)[1]
    before, goal = u.clone(), torch.full((2,), 1e-2, dtype=torch.float64)
    part.settle(u, torch.zeros_like(u), goal, torch.full((2,), -torch.inf), torch.ones(2, dtype=torch.bool))
    assert moves[:, 0].any() and not moves[:, 1].any() and touched[known].all()
    assert torch.equal(u[~moves[:, 0], :, 0], before[~moves[:, 0], :, 0])
    assert torch.equal(u[:, :, 1], before[:, :, 1])
    force = elements.evaluate(u[:, :, 0].numpy())[1]
    assert np.linalg.norm(force[moves[:, 0]]) <= 1e-2


def test_sliding_nodes_of_hard_patches_move_in_their_tangent_planes():
    elements, part = bent_zone()
    known = torch.zeros(len(elements.patch_volumes), 2, dtype=torch.bool)
    known[3:6] = True
    moves = part.around(known)[0][:, 0].numpy()
    part.prepare(known)
    u, goal = state(elements, 0.03)[1], torch.full((2,), 1e-2, dtype=torch.float64)
    across, sliding = np.zeros((elements.nodes, 3, 2)), np.flatnonzero(moves)[::3]
    across[sliding] = np.random.default_rng(1).normal(size=(len(sliding), 3, 2))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    before = u.clone().numpy()
    part.settle(u, torch.as_tensor(across), goal, -torch.inf * goal, goal > 0)
    change = u.numpy() - before
    assert np.abs(change[sliding, :, 0]).max() > 0.01
    assert np.abs((change * across).sum(axis=1)).max() < 1e-6
    force = elements.evaluate(u[:, :, 0].numpy())[1][moves]
    pressed = (force * across[moves, :, 0]).sum(axis=1)
    assert np.linalg.norm(force - pressed[:, None] * across[moves, :, 0]) <= 1e-2 < np.linalg.norm(pressed)


def test_products_of_rows():
    matrix = sparse.random_array((7, 5), density=0.4, rng=np.random.default_rng(0))
    x = np.random.default_rng(1).normal(size=(5, 3, 2))
    product = SparseRows(matrix, "cpu", torch.float64)(torch.as_tensor(x))
    np.testing.assert_allclose(product, np.einsum("ij,jab->iab", matrix.toarray(), x), atol=1e-14)


def test_batches_as_by_the_solver_of_one_plan():
    """A block of 1,500 nodes; more plans than slots, so that one begins where another ends."""
    points, cells, boundary = bent_block(steps=(20, 9, 6))
    law, options = material(len(cells)), fem_settings()
    plans = plans_of(boundary, (0.3, 1.0, 0.0, -0.5))
    solver, alone = (
        BatchSolver(points, cells, law, boundary, options, "cpu", 2),
        KeptFactors(points, cells, law, boundary, options),
    )
    results, exact = solver.solve(plans), alone.solve(plans)
    for one, other in zip(results, exact, strict=True):
        assert one.kept and one.converged and one.residual <= options.tolerance
        np.testing.assert_allclose(one.displacement, other.displacement, rtol=0, atol=1e-3)
        assert one.min_jacobian == pytest.approx(other.min_jacobian, abs=1e-3)
        assert one.iterations <= other.iterations + 5
    again = solver.solve(plans)
    for one, other in zip(results, again, strict=True):
        np.testing.assert_array_equal(one.displacement, other.displacement)
    solver.close()
    alone.close()


def test_hard_patches_of_batches_as_by_the_solver_of_one_plan(monkeypatch):
    monkeypatch.setattr(kept_factors, "HARD_RATIO", 0.95)
    points, cells = box(BLOCK, (8, 6, 4))
    boundary, options = block_boundary(points), fem_settings(tolerance=1e-8)
    doubled = BoundaryConditions(boundary.prescribed_nodes, 2 * boundary.displacement(1.0))
    solver = BatchSolver(points, cells, uniform(len(cells)), boundary, options, "cpu")
    alone = KeptFactors(points, cells, uniform(len(cells)), boundary, options)
    for one, other in zip(solver.solve([boundary, doubled]), alone.solve([boundary, doubled]), strict=True):
        assert one.kept
        np.testing.assert_allclose(one.displacement, other.displacement, rtol=0, atol=1e-5)
    solver.close()
    alone.close()


def test_what_fails_in_a_batch_goes_to_the_solver_of_one_plan(monkeypatch):
    points, cells, boundary = bent_block()
    options = fem_settings()
    solver = BatchSolver(points, cells, material(len(cells)), boundary, options, "cpu")
    monkeypatch.setattr(kept_factors, "ITERATIONS", 4)
    hard, light = solver.solve(plans_of(boundary, (1.0, 1e-3)))
    assert light.kept and hard.converged and not hard.kept  # four iterations do not serve the solver of one plan either
    solver.close()


@pytest.mark.parametrize("error", [torch.OutOfMemoryError, batch_sliding.TooManyPointsError])
def test_plans_that_the_device_cannot_hold_are_solved_on_the_cpu(error, monkeypatch):
    points, cells, boundary = bent_block()
    solver = BatchSolver(points, cells, material(len(cells)), boundary, fem_settings(), "cpu")

    def full(motions):
        raise error("too much")

    monkeypatch.setattr(solver, "fields", full)
    (result,) = solver.solve([boundary])
    assert result.converged and result.kept
    solver.close()


def test_a_plan_that_strays_is_reached_in_the_least_increments(monkeypatch):
    points, cells, boundary = bent_block()
    solver = BatchSolver(points, cells, material(len(cells)), boundary, fem_settings(), "cpu")
    monkeypatch.setattr(kept_factors, "STRAY", 0.0)
    _, (progress,) = solver.fields([solver.prescribed(boundary)])
    assert progress.solved and progress.share == kept_factors.LEAST_INCREMENT
    ends = [entry["fraction"] for entry in progress.history if entry["code"] == plan_batches.SOLVED]
    assert ends == [1, 0.25, 0.125, *np.arange(1, 17) / 16]
    solver.close()


@pytest.mark.parametrize("arm", ["bonded", "mucosa"])
def test_a_patient_takes_the_device(arm, monkeypatch):
    made = []

    class Made(BatchSolver):
        def __init__(self, *arguments):
            made.append(arguments[-1])
            super().__init__(*arguments[:-1], "cpu")

    monkeypatch.setattr(plan_batches, "BatchSolver", Made)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    model, settings, fields = slab_patient(), fem_settings(), []
    plan = Plan("P", {"mandible_distal": RigidMotion.from_degrees([0, 2, 0], [2, 1, 1.0], [12, 6, 0])})
    for device in ("cuda", "cpu"):
        (result,) = simulate(model, [plan], settings, arm=arm, device=device)
        assert result.kept and result.violation < 1e-8
        fields.append(result.displacement)
    assert made == ["cuda"]
    np.testing.assert_allclose(fields[0], fields[1], rtol=0, atol=1e-3)


@pytest.mark.parametrize("device", ["cuda", "meta"])
def test_a_device_that_torch_does_not_have_is_refused(device, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=f"no device '{device}'"):
        Simulator(slab_patient(), fem_settings(), device=device)


def sliding_plans() -> tuple:
    """A slab whose nodes slide on one bone, in motions that turn their normals; points, cells, law, boundaries."""
    model, settings = slab_patient(), fem_settings()
    turns = [0, 4, 0], [3, -5, 8], [0, 0, 0]
    motions = [RigidMotion.from_degrees(turn, [2, 1, 1.0], [12, 6, 0]) for turn in turns]
    plans = [boundary_conditions(model, Plan("P", {"mandible_distal": motion}), "mucosa") for motion in motions]
    return model.points, model.cells, settings.material(model.tissue), plans


def test_sliding_plans_as_by_the_solver_of_one_plan():
    points, cells, law, plans = sliding_plans()
    options = fem_settings(tolerance=1e-8)
    solver = BatchSolver(points, cells, law, plans[0], options, "cpu", 2)
    alone = KeptFactors(points, cells, law, plans[0], options)
    linear = solver.linear(torch.as_tensor(solver.prescribed(plans[1]).motion)[solver._order][:, :, None])
    exact = alone._rest.spread(solver.prescribed(plans[1]).motion[None])[0]
    np.testing.assert_allclose(linear[:, :, 0][solver._place], exact, rtol=0, atol=1e-4)
    for one, other in zip(solver.solve(plans), alone.solve(plans), strict=True):
        assert one.kept and one.residual <= options.tolerance and one.violation < 1e-8
        np.testing.assert_allclose(one.displacement, other.displacement, rtol=0, atol=1e-4)
    solver.close()
    alone.close()


@pytest.mark.parametrize(("name", "value"), [("RIM", 1.1), ("SLIDE", 0.0)])
def test_a_plan_whose_nodes_slid_far_is_reached_in_the_least_increments(name, value, monkeypatch):
    points, cells, law, plans = sliding_plans()
    solver = BatchSolver(points, cells, law, plans[0], fem_settings(), "cpu", 1)
    monkeypatch.setattr(kept_factors, name, value)
    _, (progress,) = solver.fields([solver.prescribed(plans[0])])
    assert progress.solved and progress.share == kept_factors.LEAST_INCREMENT
    solver.close()


on_a_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


@on_a_gpu
def test_hard_patches_on_a_gpu_as_on_a_cpu():
    from pinnochio.mechanics.solvers.batched import hard_patches_gpu

    fields = []
    for kind, device in ((hard_patches.HardPatches, "cpu"), (hard_patches_gpu.GpuHardPatches, "cuda")):
        elements, part = bent_zone(kind, device)
        known = torch.zeros(len(elements.patch_volumes), 2, dtype=torch.bool)
        known[3:6, 0] = known[8, 1] = True
        u = state(elements, 0.03)[1].to(device)
        part.prepare(known.to(device))
        goal = torch.full((2,), 1e-2, dtype=torch.float64, device=device)
        part.settle(u, torch.zeros_like(u), goal, -torch.inf * goal, goal > 0)
        assert not part.open.any()
        fields.append(u.cpu())
    np.testing.assert_allclose(fields[1], fields[0], rtol=0, atol=1e-5)


@on_a_gpu
def test_batches_on_a_gpu_as_on_a_cpu():
    points, cells, boundary = bent_block(steps=(12, 6, 4))
    law, options = material(len(cells)), fem_settings()
    solvers = [BatchSolver(points, cells, law, boundary, options, device, 2) for device in ("cpu", "cuda", "cuda")]
    one, two, three = (solver.solve(plans_of(boundary, (0.3, 1.0, -0.5))) for solver in solvers)
    for cpu, gpu, again in zip(one, two, three, strict=True):
        np.testing.assert_allclose(gpu.displacement, cpu.displacement, rtol=0, atol=1e-3)
        np.testing.assert_array_equal(gpu.displacement, again.displacement)


@on_a_gpu
def test_sliding_nodes_on_a_gpu_as_on_a_cpu():
    from pinnochio.mechanics.solvers.batched import batch_sliding_gpu

    points, cells, law, plans = sliding_plans()
    solver = BatchSolver(points, cells, law, plans[0], fem_settings(), "cpu")
    bones, results = solver._bones, []
    start = np.stack([solver.prescribed(plan).motion for plan in plans], axis=2) + np.array([0.3, 0.2, 0.1])[:, None]
    for kind, device in ((batch_sliding.BatchSliding, "cpu"), (batch_sliding_gpu.GpuSliding, "cuda")):
        held, u = kind(bones, len(plans), device), torch.tensor(start, device=device)
        held.begin(range(len(plans)), [SlidingNodes(bones, solver.prescribed(plan).sliding) for plan in plans])
        held.project(u, torch.ones(len(plans), dtype=torch.bool, device=device))
        results.append((u.cpu(), held.axes.cpu()))
    for cpu, gpu in zip(*results, strict=True):
        np.testing.assert_allclose(gpu, cpu, rtol=0, atol=1e-8)


@on_a_gpu
def test_sliding_plans_on_a_gpu_as_on_a_cpu():
    points, cells, law, plans = sliding_plans()
    one, two, three = (
        BatchSolver(points, cells, law, plans[0], fem_settings(), device, 2).solve(plans)
        for device in ("cpu", "cuda", "cuda")
    )
    for cpu, gpu, again in zip(one, two, three, strict=True):
        assert gpu.kept
        np.testing.assert_allclose(gpu.displacement, cpu.displacement, rtol=0, atol=1e-3)
        np.testing.assert_array_equal(gpu.displacement, again.displacement)
