"""Energy, force and tangent of the elements against closed forms, finite differences, autograd and felupe."""

import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.spatial.transform import Rotation

from pinnochio.errors import InputError
from pinnochio.mechanics.elements.assembly import Assembler, diagonal_blocks
from pinnochio.mechanics.elements.materials import Material, lame
from pinnochio.mechanics.elements.residual import Operator
from pinnochio.mechanics.elements.tetrahedra import Elements, jacobians, mean_edge
from pinnochio.mechanics.problems import box
from tests.helpers.solids import both, material


def operator(points, cells, law, volumetric, dtype=torch.float64):
    return Operator.build(points, cells, law, volumetric, dtype)


STATES = {"mild": 0.04, "strong": 0.15, "inverted": 0.6}


@pytest.fixture(params=STATES)
def problem(request):
    points, cells = box((9, 6, 6), (3, 2, 2), jitter=0.2)
    law = material(len(cells))
    displacement = np.random.default_rng(1).normal(0, STATES[request.param] * 3, points.shape)
    least = jacobians(points, cells, displacement).min()
    assert (least < 0) == (request.param == "inverted")
    return points, cells, law, displacement


@both
def test_force_is_the_gradient_of_the_energy(problem, volumetric):
    points, cells, law, u = problem
    energy, force, least = Elements.build(points, cells, law, volumetric).evaluate(u)
    unknown = torch.tensor(u, requires_grad=True)
    op = operator(points, cells, law, volumetric)
    op.energy(unknown).backward()
    scale = np.abs(force).max()
    assert energy == pytest.approx(op.energy(unknown).item(), rel=1e-10)
    np.testing.assert_allclose(op.force(unknown).detach(), force, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(unknown.grad, force, rtol=0, atol=1e-10 * scale)
    assert least == pytest.approx(op.jacobians(unknown).min().item(), rel=1e-10)
    assert least == pytest.approx(jacobians(points, cells, u).min(), rel=1e-10)


def assembled(assembler, data):
    """The whole tangent of the free unknowns, from its upper triangle."""
    upper = assembler.upper(data)
    return (upper + sparse.triu(upper, 1).T).toarray()


@both
def test_tangent_is_the_derivative_of_the_force(problem, volumetric):
    points, cells, law, u = problem
    elements = Elements.build(points, cells, law, volumetric)
    assembler = Assembler(elements, np.zeros(points.shape, bool), np.zeros(0, int))
    data, _ = assembler.tangent(u, np.zeros((0, 3, 3)))
    tangent = assembled(assembler, data)
    step, columns = 1e-6, []
    for i in range(u.size):
        push = np.zeros(u.size)
        push[i] = step
        push = push.reshape(u.shape)
        columns.append((elements.evaluate(u + push)[1] - elements.evaluate(u - push)[1]).ravel() / (2 * step))
    expected = np.stack(columns, axis=1)
    np.testing.assert_allclose(tangent, expected, rtol=0, atol=2e-7 * np.abs(expected).max())
    np.testing.assert_allclose(
        diagonal_blocks(elements, u),
        [expected[3 * a : 3 * a + 3, 3 * a : 3 * a + 3] for a in range(len(points))],
        rtol=0,
        atol=2e-7 * np.abs(expected).max(),
    )


@both
def test_tangent_in_frames_and_its_product_with_an_imposed_step(problem, volumetric):
    points, cells, law, u = problem
    elements = Elements.build(points, cells, law, volumetric)
    whole = Assembler(elements, np.zeros(points.shape, bool), np.zeros(0, int))
    full = assembled(whole, whole.tangent(u, np.zeros((0, 3, 3)))[0])
    framed, fixed = np.array([4, 7, 20]), np.array([0, 1, 11])
    frames = Rotation.random(3, random_state=2).as_matrix()
    constrained = np.zeros(points.shape, bool)
    constrained[fixed], constrained[framed, 0] = True, True
    turn = np.eye(u.size)
    for node, frame in zip(framed, frames, strict=True):
        turn[3 * node : 3 * node + 3, 3 * node : 3 * node + 3] = frame
    turned = turn @ full @ turn.T
    free = ~constrained.ravel()
    assembler = Assembler(elements, constrained, framed)
    imposed = np.where(constrained, np.random.default_rng(0).normal(size=u.shape), 0)
    data, product = assembler.tangent(u, frames, imposed)
    expected = turned[free][:, free]
    np.testing.assert_allclose(assembled(assembler, data), expected, rtol=0, atol=1e-9 * np.abs(full).max())
    reference = (turned @ imposed.ravel())[free]
    np.testing.assert_allclose(product, reference, rtol=0, atol=1e-9 * np.abs(reference).max())


@both
def test_definite_tangent_is_definite_and_leaves_a_definite_one_alone(problem, volumetric):
    points, cells, law, u = problem
    elements = Elements.build(points, cells, law, volumetric)
    constrained = np.zeros(points.shape, bool)
    constrained[points[:, 0] == 0] = True
    assembler = Assembler(elements, constrained, np.zeros(0, int))
    none = np.zeros((0, 3, 3))
    cut = assembled(assembler, assembler.tangent(u, none, definite=True)[0])
    assert np.linalg.eigvalsh(cut).min() > 0
    rest = np.zeros_like(u)
    plain, cut = (assembled(assembler, assembler.tangent(rest, none, definite=x)[0]) for x in (False, True))
    np.testing.assert_allclose(cut, plain, rtol=0, atol=1e-10 * np.abs(plain).max())


@both
def test_rigid_motion_changes_nothing(problem, volumetric):
    points, cells, law, u = problem
    elements = Elements.build(points, cells, law, volumetric)
    rotation = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
    moved = (points + u) @ rotation.T + [3, -40, 7] - points
    energy, force, _ = elements.evaluate(u)
    turned_energy, turned_force, _ = elements.evaluate(moved)
    assert turned_energy == pytest.approx(energy, rel=1e-10)
    np.testing.assert_allclose(turned_force, force @ rotation.T, rtol=0, atol=1e-9 * np.abs(force).max())
    energy, force, _ = elements.evaluate(points @ rotation.T - points)
    assert abs(energy) < 1e-9
    assert np.abs(force).max() < 1e-9


@both
def test_rest_is_free_of_stress_across_tissues(volumetric):
    points, cells = box((9, 6, 6), (3, 2, 2), jitter=0.2)
    energy, force, least = Elements.build(points, cells, material(len(cells)), volumetric).evaluate(0 * points)
    assert energy == 0
    assert least == pytest.approx(1, abs=1e-12)
    assert np.abs(force).max() < 1e-11


@both
def test_linearisation_is_isotropic_elasticity(volumetric):
    points, cells = box((6, 6, 6), (2, 2, 2), jitter=0.2)
    mu, lam = lame(6.0, 0.49)
    count = len(cells)
    law = Material(np.full(count, mu), np.full(count, lam), np.full(count, 2.0))
    h = 1e-6 * np.array([[1.0, 0.5, 0], [-0.2, 0.7, 0.3], [0.4, 0.1, -0.6]])
    energy, _, _ = Elements.build(points, cells, law, volumetric).evaluate(points @ h.T)
    strain = (h + h.T) / 2
    # I1 - 3 is 2 tr(strain) to first order: the stiffening adds 4 times its constant to lambda.
    expected = 216 * (mu * (strain**2).sum() + (lam + 4 * 2.0) / 2 * np.trace(strain) ** 2)
    assert energy == pytest.approx(expected, rel=1e-4)


@both
def test_physics_loss_has_a_gradient_past_inversion(problem, volumetric):
    points, cells, law, u = problem
    op = operator(points, cells, law, volumetric)
    unknown = torch.tensor(u, requires_grad=True)
    (op.force(unknown) ** 2).sum().backward()
    assert torch.isfinite(unknown.grad).all()
    direction = torch.tensor(np.random.default_rng(5).normal(size=u.shape))
    loss = [(op.force(torch.tensor(u) + sign * 1e-6 * direction) ** 2).sum().item() for sign in (1, -1)]
    slope = (loss[0] - loss[1]) / 2e-6
    assert (unknown.grad * direction).sum().item() == pytest.approx(slope, rel=1e-5)


@both
def test_single_precision_agrees(problem, volumetric):
    points, cells, law, u = problem
    exact = operator(points, cells, law, volumetric).force(torch.tensor(u))
    single = operator(points, cells, law, volumetric, torch.float32).force(torch.tensor(u).float())
    assert single.dtype == torch.float32
    assert (single - exact).norm() < 3e-5 * exact.norm()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no GPU")
@both
@pytest.mark.parametrize(("dtype", "limit"), [(torch.float64, 1e-12), (torch.float32, 3e-5)])
def test_gpu_agrees(problem, volumetric, dtype, limit):
    points, cells, law, u = problem
    exact = operator(points, cells, law, volumetric).force(torch.tensor(u))
    there = Operator.build(points, cells, law, volumetric, dtype, "cuda").force(torch.tensor(u, dtype=dtype).cuda())
    assert (there.cpu() - exact).norm() < limit * exact.norm()


def test_mean_edge_of_a_single_tetrahedron():
    points = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 12.0]])
    assert mean_edge(points, np.array([[0, 1, 2, 3]])) == pytest.approx(
        (3 + 4 + 12 + 5 + np.hypot(3, 12) + np.hypot(4, 12)) / 6
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p, c: (p, c[:, [1, 0, 2, 3]]), "positive volume"),
        (lambda p, c: (p, c + 1000), "does not exist"),
        (lambda p, c: (np.where(p == 6, np.nan, p), c), "not finite"),
        (lambda p, c: (p[:, :2], c), "shapes"),
    ],
)
def test_a_bad_mesh_is_refused(change, message):
    points, cells = change(*box((6, 6, 6), (1, 1, 1)))
    with pytest.raises(InputError, match=message):
        Elements.build(points, cells, material(len(cells)))
