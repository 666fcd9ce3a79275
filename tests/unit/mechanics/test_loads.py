"""Dead loads and the tension of a surface: exact gradients, balance of forces, equilibrium of the solved field."""

import numpy as np
import pytest
from scipy import sparse

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import boundary_faces
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.loads import Loads, OuterForces, surface_stiffness
from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.elements.tetrahedra import Elements, lumped
from pinnochio.mechanics.solvers.newton import solve
from tests.helpers.heads import kuhn_cube
from tests.helpers.settings import fem_settings


@pytest.fixture(scope="module")
def block():
    """A cube of 20 mm whose top is a skin."""
    mesh = kuhn_cube(4)
    points = 20 * mesh.points
    faces, _ = boundary_faces(mesh.cells)
    return points, mesh.cells, faces[(points[faces][:, :, 2] > 20 - 1e-9).all(axis=1)]


def solved(block, loads, **options):
    points, cells, _ = block
    material = neo_hookean(np.ones(len(cells), int), {1: 4.0}, 0.45)
    bottom = np.flatnonzero(points[:, 2] == 0)
    boundary = BoundaryConditions(bottom, np.zeros((len(bottom), 3)), loads=loads)
    return solve(points, cells, material, boundary, fem_settings(volumetric="p1", tolerance=1e-9, **options)), material


def weight(block, down):
    points, cells, _ = block
    volumes = Elements.build(points, cells, neo_hookean(np.ones(len(cells), int), {1: 4.0}, 0.45)).volumes
    return 0.00981 * lumped(cells, volumes, len(points))[:, None] * down


def test_the_gradient_is_that_of_the_energy(block):
    points, _, faces = block
    draws = np.random.default_rng(0)
    springs = sparse.random_array((4, len(points)), density=0.1, rng=draws)
    held = sparse.csr_array(springs.T @ springs)
    outer = OuterForces(points, Loads(draws.normal(size=points.shape), faces, draws.uniform(1, 5, len(faces)), held))
    u, step = draws.normal(0, 1, points.shape), 1e-5
    _, gradient = outer.evaluate(u, 0.7)
    for node, axis in ((faces[0, 0], 0), (faces[3, 1], 2), (0, 1)):
        bump = np.zeros_like(u)
        bump[node, axis] = step
        difference = (outer.evaluate(u + bump, 0.7)[0] - outer.evaluate(u - bump, 0.7)[0]) / (2 * step)
        assert gradient[node, axis] == pytest.approx(difference, rel=1e-6, abs=1e-7)
    hessian = np.zeros((len(points), len(points)))
    hessian[tuple(outer.pairs.T)] = outer.blocks[:, 0, 0]
    hessian += np.triu(hessian, 1).T
    assert np.allclose(hessian @ u - 0.7 * outer.forces, gradient)


def test_tension_is_balanced_and_resists_bending_by_its_curvature(block):
    points, _, faces = block
    matrix = surface_stiffness(points, faces, np.full(len(faces), 3.0))
    assert np.allclose(matrix @ np.ones(len(points)), 0)  # a translation, and no force in sum
    wave = np.zeros(len(points))
    wave[np.unique(faces)] = points[np.unique(faces), 0] ** 2
    inner = [n for n in np.unique(faces) if (np.abs(points[n, :2] - 10) < 9.9).all()]
    pull = (matrix @ wave)[inner] / 25  # per area: every inner node owns a square of 5 mm
    assert np.allclose(pull, -3.0 * 2)  # T times the second derivative
    assert np.linalg.eigvalsh(matrix.toarray()).min() > -1e-9


def test_a_body_hangs_in_equilibrium_and_stays_without_weight(block):
    points, cells, faces = block
    result, material = solved(block, Loads(weight(block, [0, 0, -1.0]), np.zeros((0, 3), int), np.zeros(0)))
    assert result.converged
    inner = Elements.build(points, cells, material, "p1").evaluate(result.displacement)[1]
    free = points[:, 2] > 0
    assert np.abs(inner - weight(block, [0, 0, -1.0]))[free].max() < 1e-6
    assert np.isclose(inner[~free][:, 2].sum(), -weight(block, [0, 0, -1.0])[free][:, 2].sum())  # the floor carries it
    top = points[:, 2] == 20
    # A column under its own weight sinks by rho g h^2 / 2 M, between its moduli with free and with held sides.
    sunk = -result.displacement[top, 2].mean()
    assert 0.00981 * 400 / 2 / 15.2 < sunk < 0.00981 * 400 / 2 / 4
    still, _ = solved(block, Loads(np.zeros_like(points), faces, np.full(len(faces), 5.0)))
    assert still.converged and np.abs(still.displacement).max() == 0


def test_a_tense_skin_bulges_less_and_does_not_hinder_a_shift(block):
    points, cells, faces = block
    push = np.zeros_like(points)
    push[np.argmin(np.linalg.norm(points - [10, 10, 20], axis=1)), 2] = 40
    slack, _ = solved(block, Loads(push, faces, np.zeros(len(faces))))
    tense, _ = solved(block, Loads(push, faces, np.full(len(faces), 20.0)))
    assert tense.converged and tense.displacement[:, 2].max() < 0.6 * slack.displacement[:, 2].max()


def test_increments_reach_the_same_equilibrium(block):
    load = Loads(weight(block, [0, 8.0, -8]), block[2], np.full(len(block[2]), 4.0))
    one, four = (solved(block, load, increments=count)[0] for count in (1, 4))
    assert one.converged and four.converged and np.abs(one.displacement - four.displacement).max() < 1e-5


def test_loads_of_another_mesh_are_refused(block):
    points, _, faces = block
    for forces, tension in ((points[:3], np.ones(len(faces))), (points, np.ones(2)), (points, -np.ones(len(faces)))):
        with pytest.raises(InputError):
            OuterForces(points, Loads(forces, faces, tension))
