"""Elements with pressure unknowns: gradients, felupe, closed forms, and no locking where plain elements lock."""

from types import SimpleNamespace

import felupe
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from scipy.special import lambertw

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.materials import Material, lame
from pinnochio.mechanics.elements.mixed import EDGES, MIXED, MixedElements
from pinnochio.mechanics.problems import BLOCK, block_boundary, box, uniform
from pinnochio.mechanics.solvers.mixed_newton import solve_mixed
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.plans.plan import RigidMotion
from tests.helpers.settings import fem_settings
from tests.helpers.solids import bent_block

every = pytest.mark.parametrize("element", MIXED)


def two_tissues(count, poisson=0.49, stiffening=1.5):
    modulus = np.where(np.random.default_rng(3).random(count) < 0.5, 4.0, 6.0)
    return Material(*lame(modulus, poisson), np.full(count, stiffening))


def skin_of(points, size):
    return np.flatnonzero(((points == 0) | (points == np.array(size))).any(axis=1))


# ---- the pieces


@pytest.fixture(params=MIXED)
def state(request):
    """An element, a mesh, and a displacement and a pressure at random."""
    points, cells = box((6, 6, 3), (2, 2, 1), jitter=0.2)
    points += np.random.default_rng(8).normal(0, 0.2, points.shape)
    law = two_tissues(len(cells))
    elements = MixedElements(points, cells, law, request.param)
    rng = np.random.default_rng(1)
    u = rng.normal(0, 0.12, elements.points.shape)
    p = rng.normal(0, 3.0, len(points))
    least = elements.evaluate(u, p)[2]
    assert 0.2 < least < 0.9
    return elements, law, points, cells, u, p


def monomials(x):
    """Gradients (10, 3) of 1, x, y, z, xx, yy, zz, xy, yz, zx and their values (10,) at x (3,)."""
    a, b, c = x
    values = np.array([1, a, b, c, a * a, b * b, c * c, a * b, b * c, c * a])
    gradient = np.zeros((10, 3))
    gradient[1:4] = np.eye(3)
    gradient[4:7] = 2 * np.diag(x)
    gradient[7], gradient[8], gradient[9] = [b, a, 0], [0, c, b], [c, 0, a]
    return values, gradient


def conjugate(q, lam):
    """U*(q) of U = lam/2 (ln J)^2: q J - U(J) where dU/dJ = q, by Newton's method."""
    log = torch.zeros_like(q.detach())
    for _ in range(60):
        log = log - (lam * log * torch.exp(-log) - q.detach()) / (lam * (1 - log) * torch.exp(-log))
    # By the envelope theorem J counts as constant; its own derivative drops out.
    return q * torch.exp(log) - lam / 2 * log**2


def energy(element, law, points, cells, u, q):
    """W, cell by cell, from interpolation polynomials instead of shape functions; u and q are torch tensors.

    "averaged": the largest value over q, which is written to `q`.
    """
    inner, outer = 0.5854101966249685, 0.1381966011250105
    rule = outer + (inner - outer) * np.eye(4)  # exact for quadratic polynomials
    edges = np.unique(np.sort(cells[:, EDGES], axis=2).reshape(-1, 2), axis=0).tolist()
    volumes = np.abs(np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]])) / 6
    total, star = 0.0, [[] for _ in points]
    for e, cell in enumerate(cells):
        x, mu, lam, v = points[cell], law.mu[e], law.lam[e], volumes[e]
        nodes, places = list(cell), x
        if element == "taylor_hood":
            nodes = nodes + [len(points) + edges.index(sorted(cell[list(pair)].tolist())) for pair in EDGES]
            places = np.vstack([x, x[EDGES].mean(axis=1)])
        terms = len(places)
        matrix = np.linalg.inv(np.array([monomials(place)[0][:terms] for place in places]))
        corner_values = q[cell.tolist()]
        for at in rule:
            shape = torch.tensor(matrix.T @ monomials(at @ x)[1][:terms])
            f = torch.eye(3, dtype=torch.float64) + u[nodes].T @ shape
            j, excess = torch.linalg.det(f), (f * f).sum() - 3
            total = total + v / 4 * (mu / 2 * excess + law.stiffening[e] / 2 * excess**2 - mu * torch.log(j))
            value = corner_values @ torch.tensor(at)
            if element != "averaged":
                total = total + v / 4 * (value * j - conjugate(value, lam))
            if element == "stabilised":
                total = total - v / 4 * (value - corner_values.mean()) ** 2 / (2 * mu)
        for a in cell:
            star[a].append((v / 4, j, lam))
    for a, around in enumerate(star if element == "averaged" else []):
        share = sum(v for v, _, _ in around)
        j = sum(v * j for v, j, _ in around) / share
        lam = sum(v * lam for v, _, lam in around) / share
        total = total + share * lam / 2 * torch.log(j) ** 2
        q.data[a] = lam * torch.log(j.detach()) / j.detach()
    return total


def test_gradient_of_an_energy_written_otherwise(state):
    elements, law, points, cells, u, p = state
    unknown = [torch.tensor(u, requires_grad=True), torch.tensor(p, requires_grad=True)]
    expected = energy(elements.element, law, points, cells, *unknown)
    expected.backward()
    value, gradient, _ = elements.evaluate(u, unknown[1].detach().numpy())
    if elements.element == "averaged":
        wanted = np.concatenate([unknown[0].grad.numpy().ravel(), np.zeros(len(p))])
    else:
        wanted = np.concatenate([each.grad.numpy().ravel() for each in unknown])
    assert value == pytest.approx(expected.item(), rel=1e-10)
    np.testing.assert_allclose(gradient, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_tangent_is_the_derivative_of_the_gradient(state):
    elements, _, _, _, u, p = state
    both, size = np.concatenate([u.ravel(), p]), u.size
    columns = []
    for i in range(len(both)):
        ends = []
        for step in (1e-6, -1e-6):
            moved = both.copy()
            moved[i] += step
            ends.append(elements.evaluate(moved[:size].reshape(u.shape), moved[size:])[1])
        columns.append((ends[0] - ends[1]) / 2e-6)
    expected = np.stack(columns, axis=1)
    free = np.arange(5, len(both))
    step = np.random.default_rng(2).normal(size=len(both))
    matrix, product = elements.tangent(u, p, step, free)
    upper = matrix.toarray()
    assert not np.tril(upper, -1).any()
    scale = np.abs(expected).max()
    np.testing.assert_allclose(upper, np.triu(expected[5:, 5:]), rtol=0, atol=2e-7 * scale)
    np.testing.assert_allclose(product, expected @ step, rtol=0, atol=2e-6 * scale)


def test_averaged_energy_is_that_of_averaged_volumes():
    """Whatever q, W lies below the energy of the averaged volumes and reaches it at q = dU/dJ_a."""
    points, cells = box((6, 6, 3), (2, 2, 1), jitter=0.2)
    law = two_tissues(len(cells))
    elements = MixedElements(points, cells, law, "averaged")
    u = np.random.default_rng(1).normal(0, 0.12, points.shape)
    p = torch.zeros(len(points), dtype=torch.float64)
    highest = energy("averaged", law, points, cells, torch.tensor(u), p).item()
    for push in np.random.default_rng(2).normal(0, 2.0, (5, len(points))):
        assert elements.evaluate(u, p.numpy() + push)[0] < highest
    assert elements.evaluate(u, p.numpy())[0] == pytest.approx(highest, rel=1e-12)


# ---- solutions


@every
@pytest.mark.parametrize(("stretch", "poisson"), [(0.25, 0.49), (0.05, 0.4999)])
def test_patch(element, stretch, poisson):
    points, cells = box((9, 9, 9), (3, 3, 3), jitter=0.25)
    skin = skin_of(points, (9, 9, 9))
    h = stretch * np.array([[1, 0.4, -0.2], [0.3, -0.6, 0.5], [0, 0.7, 0.4]])
    law = uniform(len(cells), poisson, stiffening=1.0)
    result = solve_mixed(points, cells, law, BoundaryConditions(skin, points[skin] @ h.T), element, tolerance=1e-12)
    assert result.converged, result.reason
    assert len(skin) < len(points)
    np.testing.assert_allclose(result.displacement, points @ h.T, rtol=0, atol=1e-10)
    np.testing.assert_allclose(result.everywhere, result.points @ h.T, rtol=0, atol=1e-10)
    j = np.linalg.det(np.eye(3) + h)
    np.testing.assert_allclose(result.pressure, law.lam[0] * np.log(j), rtol=1e-8)
    assert result.min_jacobian == pytest.approx(j, rel=1e-10)


@every
def test_rigid_motion_is_followed_without_strain(element):
    points, cells = box((12, 8, 8), (3, 2, 2), jitter=0.2)
    motion = RigidMotion(Rotation.from_rotvec([0.2, 0.5, -0.4]).as_matrix(), np.array([5.0, -3, 8]))
    end = np.flatnonzero(points[:, 0] == 0)
    boundary = BoundaryConditions(end, lambda t: motion.fraction(t).displacement(points[end]))
    result = solve_mixed(points, cells, two_tissues(len(cells)), boundary, element, tolerance=1e-10)
    assert result.converged, result.reason
    np.testing.assert_allclose(result.everywhere, motion.displacement(result.points), rtol=0, atol=1e-7)
    np.testing.assert_allclose(result.pressure, 0, atol=1e-6)


@every
def test_equilibrium_does_not_depend_on_increments_or_the_linear_solver(element):
    points, cells, boundary = bent_block((6, 3, 2), 7.5, 15)
    law = two_tissues(len(cells))
    fields = []
    for increments, kind in ((1, "pardiso"), (5, "scipy")):
        result = solve_mixed(points, cells, law, boundary, element, increments, 1e-11, linear_kind=kind)
        assert result.converged, result.reason
        assert result.residual <= 1e-11
        prescribed = boundary.prescribed_nodes
        np.testing.assert_allclose(result.displacement[prescribed], boundary.displacement(1.0), rtol=0, atol=1e-12)
        fields.append(result.everywhere)
    np.testing.assert_allclose(fields[0], fields[1], rtol=0, atol=1e-9)


def test_taylor_hood_balances_in_felupe():
    """FElupe interpolates and integrates the same two fields; its forces at our solution vanish on free unknowns."""
    points, cells, boundary = bent_block((6, 3, 2), 7.5, 15)
    mu, lam = lame(5.0, 0.499)
    result = solve_mixed(points, cells, uniform(len(cells), 0.499), boundary, "taylor_hood", tolerance=1e-11)
    assert result.converged, result.reason
    number = MixedElements(points, cells, uniform(len(cells), 0.499), "taylor_hood").cells
    region = felupe.RegionQuadraticTetra(felupe.Mesh(result.points, number, "tetra10"))
    linear = felupe.RegionTetra(felupe.Mesh(points, cells, "tetra"), quadrature=region.quadrature, grad=False)
    displacement = felupe.Field(region, dim=3, values=result.everywhere)
    conjugate_field = result.pressure * np.exp(-result.pressure / lam)
    pressure = felupe.Field(linear, dim=1, values=conjugate_field[:, None])
    f = displacement.extract(grad=True, sym=False, add_identity=True)
    q, j = pressure.interpolate()[0], felupe.math.det(f)
    stress = mu * f + (q * j - mu) * felupe.math.transpose(felupe.math.inv(f))
    theta = np.exp(-lambertw(-q / lam).real)
    force = felupe.IntegralForm([stress], felupe.FieldContainer([displacement]), region.dV).assemble()
    gap = felupe.IntegralForm([(j - theta)[None]], felupe.FieldContainer([pressure]), region.dV, grad_v=[False])
    force, gap = force.toarray().reshape(-1, 3), gap.assemble().toarray()
    assert np.abs(result.everywhere).max() > 5
    free = (result.points[:, 0] > 1e-9) & (result.points[:, 0] < 40 - 1e-9)
    # 1e-7: FElupe's quadrature points have eight digits.
    assert np.linalg.norm(force[free]) < 1e-7 * np.linalg.norm(force)
    assert np.linalg.norm(gap) < 1e-7 * np.linalg.norm((j - 1) * region.dV)


def test_taylor_hood_converges_to_a_closed_form_where_plain_elements_lock():
    """All of the skin moves by the gradient of a harmonic function: in equilibrium at small strain and free of
    divergence, whatever lam. The skin moves linearly between corners, so the error falls with the edge squared."""
    errors, amount = {}, 1e-4
    for steps in (4, 8):
        points, cells = box((8, 8, 8), (steps,) * 3, jitter=0.1)
        x, y, z = points.T - 4
        exact = amount * np.stack([x * x - y * y + 2 * x * z, -2 * x * y, x * x - z * z], axis=1)
        skin = skin_of(points, (8, 8, 8))
        boundary, law = BoundaryConditions(skin, exact[skin]), uniform(len(cells), 0.4999)
        result = solve_mixed(points, cells, law, boundary, increments=1)
        plain = solve(points, cells, law, boundary, fem_settings(volumetric="p1", increments=1, tolerance=1e-9))
        assert result.converged and plain.converged
        for name, field in (("taylor_hood", result.displacement), ("p1", plain.displacement)):
            errors[name, steps] = np.abs(field - exact).max() / np.abs(exact).max()
    assert errors["taylor_hood", 8] < 0.01
    assert errors["taylor_hood", 8] < errors["taylor_hood", 4] / 3.5
    assert errors["p1", 8] > 3 * errors["taylor_hood", 8]


def top_error(coarse, fine, elements) -> dict:
    """Mean error in mm of the top of the block problem at nu 0.4999 against Taylor-Hood on a finer mesh."""
    reference, cells = box(BLOCK, fine)
    points, few = box(BLOCK, coarse)
    whole, boundary = block_boundary(reference), block_boundary(points)
    # The coarse mesh holds the bottom as far as its nodes go: the fine one is fixed there and no further.
    edge, x = points[boundary.prescribed_nodes, 0], reference[whole.prescribed_nodes, 0]
    kept = (x <= edge[edge < BLOCK[0] / 2].max()) | (x >= edge[edge > BLOCK[0] / 2].min())
    same = BoundaryConditions(whole.prescribed_nodes[kept], lambda t: whole.displacement(t)[kept])
    truth = solve_mixed(reference, cells, uniform(len(cells), 0.4999), same)
    assert truth.converged, truth.reason
    lattice = truth.displacement.reshape(*(n + 1 for n in fine), 3)[:, :, -1]
    lattice = lattice[:: fine[0] // coarse[0], :: fine[1] // coarse[1]].reshape(-1, 3)
    law, top, error = uniform(len(few), 0.4999), points[:, 2] == BLOCK[2], {}
    for name in elements:
        if name in MIXED:
            result = solve_mixed(points, few, law, boundary, name)
        else:
            result = solve(points, few, law, boundary, fem_settings(volumetric=name))
        assert result.converged, result.reason
        error[name] = np.linalg.norm(result.displacement[top] - lattice, axis=1).mean()
    return error


def test_taylor_hood_is_right_on_a_mesh_where_the_others_are_not():
    error = top_error((5, 4, 2), (10, 8, 4), ("taylor_hood", "p1"))
    assert error["taylor_hood"] < 0.1  # of 5.5 mm
    assert error["p1"] > 8 * error["taylor_hood"]


def test_linear_elements_with_a_pressure_do_not_lock():
    error = top_error((10, 8, 4), (10, 8, 4), ("stabilised", "averaged", "p1"))
    assert error["stabilised"] < 0.15
    assert error["averaged"] < 0.3
    assert error["p1"] > 0.7


# ---- refusals and failure


def test_sliding_and_contact_are_refused():
    points, cells, boundary = bent_block((3, 2, 2), 7.5, 15)
    law = uniform(len(cells))
    prescribed = {"prescribed_nodes": boundary.prescribed_nodes, "displacement": boundary.displacement}
    for extra in ({"sliding": [object()], "contact": []}, {"sliding": [], "contact": [object()]}):
        with pytest.raises(InputError, match="no sliding, no contact and no loads"):
            solve_mixed(points, cells, law, SimpleNamespace(**prescribed, **extra))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"element": "quadratic"}, "element is 'quadratic'"),
        ({"material": uniform(3)}, "3 constants"),
        ({"points": np.vstack([bent_block((3, 2, 2), 7.5, 15)[0], [[99.0, 0, 0]]])}, "belongs to no cell"),
        ({"increments": 0}, "makes no sense"),
        ({"boundary": BoundaryConditions(np.array([0, 0, 1]), np.zeros((3, 3)))}, "named twice"),
        ({"boundary": BoundaryConditions(np.array([0, 1, 99999]), np.zeros((3, 3)))}, "absent"),
        ({"boundary": BoundaryConditions(np.array([0, 1, 2]), np.full((3, 3), np.nan))}, "finite"),
    ],
)
def test_bad_input_is_refused(change, message):
    points, cells, boundary = bent_block((3, 2, 2), 7.5, 15)
    arguments = {"points": points, "cells": cells, "material": uniform(len(cells)), "boundary": boundary}
    with pytest.raises(InputError, match=message):
        solve_mixed(**(arguments | change))


@every
def test_failure_is_reported_with_the_last_equilibrium(element):
    points, cells, _ = bent_block((4, 2, 2))
    ends = np.flatnonzero((points[:, 0] == 0) | (points[:, 0] == 40))
    crush = np.where(points[ends, :1] == 40, [-60.0, 0, 0], 0.0)  # one end pushed out through the other
    boundary = BoundaryConditions(ends, crush)
    result = solve_mixed(points, cells, uniform(len(cells)), boundary, element, min_increment=1 / 32)
    assert not result.converged
    assert "increment" in result.reason
    assert 0 < result.fraction < 40 / 60
    assert result.min_jacobian > 0
    assert result.residual <= 1e-8
    np.testing.assert_allclose(result.displacement[ends], result.fraction * crush, rtol=0, atol=1e-9)
