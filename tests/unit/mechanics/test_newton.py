"""The Newton solver: patch test, peers, bad starts, and what it says when it fails."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import felupe
import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

import pinnochio
from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.materials import lame
from pinnochio.mechanics.elements.tetrahedra import Elements, jacobians
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.linear_algebra import linear_solver
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.plans.plan import RigidMotion
from tests.helpers.settings import ROOT, fem_settings
from tests.helpers.solids import bent_block, both, material


@both
@pytest.mark.parametrize("stretch", [0.02, 0.25])
def test_patch(volumetric, stretch):
    points, cells = box((9, 9, 9), (3, 3, 3), jitter=0.25)
    skin = np.flatnonzero(((points == 0) | (points == 9)).any(axis=1))
    h = stretch * np.array([[1, 0.4, -0.2], [0.3, -0.6, 0.5], [0, 0.7, 0.4]])
    result = solve(
        points,
        cells,
        uniform(len(cells), stiffening=1.0),
        BoundaryConditions(skin, points[skin] @ h.T),
        fem_settings(volumetric=volumetric, tolerance=1e-12),
    )
    assert result.converged
    assert len(skin) < len(points)
    np.testing.assert_allclose(result.displacement, points @ h.T, rtol=0, atol=1e-10)


@both
def test_rigid_motion_is_followed_without_strain(volumetric):
    points, cells = box((12, 8, 8), (3, 2, 2), jitter=0.2)
    motion = RigidMotion(Rotation.from_rotvec([0.2, 0.5, -0.4]).as_matrix(), np.array([5.0, -3, 8]))
    end = np.flatnonzero(points[:, 0] == 0)
    boundary = BoundaryConditions(end, lambda t: motion.fraction(t).displacement(points[end]))
    result = solve(points, cells, material(len(cells)), boundary, fem_settings(volumetric=volumetric))
    assert result.converged
    np.testing.assert_allclose(result.displacement, motion.displacement(points), rtol=0, atol=1e-5)
    assert result.min_jacobian == pytest.approx(1, abs=1e-5)


def test_same_field_as_felupe():
    """FElupe's NeoHookeCompressible is the same energy; plain tetrahedra, finite strain."""
    points, cells, boundary = bent_block()
    mu, lam = lame(5.0, 0.49)
    ours = solve(
        points, cells, uniform(len(cells)), boundary, fem_settings(volumetric="p1", tolerance=1e-11)
    ).displacement
    mesh = felupe.Mesh(points, cells, "tetra")
    field = felupe.FieldContainer([felupe.Field(felupe.RegionTetra(mesh), dim=3)])
    body = felupe.SolidBody(felupe.NeoHookeCompressible(mu=mu, lmbda=lam), field)
    prescribed = np.zeros(points.shape, bool)
    prescribed[boundary.prescribed_nodes] = True
    unknowns = np.arange(points.size).reshape(points.shape)
    free, fixed = unknowns[~prescribed], unknowns[prescribed]
    for fraction in (0.25, 0.5, 0.75, 1.0):
        wanted = np.zeros(points.shape)
        wanted[boundary.prescribed_nodes] = boundary.displacement(fraction)
        for _ in range(12):
            force = body.assemble.vector(field).toarray().ravel()
            tangent = body.assemble.matrix(field).tocsr()
            step = np.zeros(points.size)
            step[fixed] = (wanted - field[0].values).ravel()[fixed]
            rhs = -(force + tangent @ step)[free]
            step[free] = sparse.linalg.spsolve(tangent[free][:, free].tocsc(), rhs)
            field[0].values[:] += step.reshape(points.shape)
            if np.abs(step).max() < 1e-11:
                break
    theirs = field[0].values
    assert np.abs(theirs).max() > 5
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8)
    elements = Elements.build(points, cells, uniform(len(cells)), "p1")
    force = body.assemble.vector(field).toarray().reshape(-1, 3)
    np.testing.assert_allclose(elements.evaluate(theirs)[1], force, rtol=0, atol=1e-10 * np.abs(force).max())


@both
def test_increments_do_not_change_the_solution_and_equilibrium_holds(volumetric):
    points, cells, boundary = bent_block()
    law = material(len(cells))
    fields = []
    for increments in (1, 5):
        result = solve(
            points, cells, law, boundary, fem_settings(volumetric=volumetric, increments=increments, tolerance=1e-9)
        )
        assert result.converged
        fields.append(result.displacement)
        force = Elements.build(points, cells, law, volumetric).evaluate(result.displacement)[1]
        free = np.setdiff1d(np.arange(len(points)), boundary.prescribed_nodes)
        assert np.linalg.norm(force[free]) < 1e-9 * np.linalg.norm(force)
        assert result.residual < 1e-9
        assert result.min_jacobian == pytest.approx(jacobians(points, cells, result.displacement).min())
        np.testing.assert_array_equal(result.displacement[boundary.prescribed_nodes], boundary.displacement(1.0))
    np.testing.assert_allclose(fields[0], fields[1], rtol=0, atol=1e-7)


@both
def test_scipy_gives_what_pardiso_gives(volumetric):
    points, cells, boundary = bent_block()
    fields = [
        solve(
            points,
            cells,
            material(len(cells)),
            boundary,
            fem_settings(volumetric=volumetric, tolerance=1e-10, linear_solver=kind),
        ).displacement
        for kind in ("pardiso", "scipy")
    ]
    np.testing.assert_allclose(*fields, rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", ["pardiso", "scipy"])
def test_linear_solver_knows_what_is_definite(kind):
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(12, 12))
    matrix = matrix @ matrix.T + 12 * np.eye(12)
    upper = sparse.csr_matrix(np.triu(matrix))
    solver = linear_solver(upper.indptr, upper.indices, kind)
    assert solver.factorize(upper.data) is True
    rhs = rng.normal(size=12)
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(matrix, rhs), rtol=1e-10)
    matrix[9:, 9:] *= -1
    assert not solver.factorize(sparse.csr_matrix(np.triu(matrix)).data)
    assert not solver.factorize(np.full(upper.nnz, np.nan))
    solver.close()


@pytest.mark.parametrize(("volumetric", "noise", "share"), [("patch", 8.0, 0.4), ("p1", 2.0, 0.05)])
def test_inverted_start_recovers(volumetric, noise, share):
    """The start itself is untangled: beginning again from rest is forbidden."""
    points, cells, boundary = bent_block()
    law = material(len(cells))
    options = fem_settings(volumetric=volumetric, tolerance=1e-9, max_iterations=60)
    expected = solve(points, cells, law, boundary, options).displacement
    start = expected + np.random.default_rng(4).normal(0, noise, points.shape)
    assert (jacobians(points, cells, start) < 0).mean() > share
    result = solve(points, cells, law, boundary, replace(options, restart=False), start=start)
    assert result.converged, result.reason
    assert result.min_jacobian > 0
    np.testing.assert_allclose(result.displacement, expected, rtol=0, atol=1e-6)


def test_a_good_start_saves_work_and_a_useless_one_is_dropped():
    points, cells, boundary = bent_block()
    law = material(len(cells))
    cold = solve(points, cells, law, boundary, fem_settings())
    noise = np.random.default_rng(4).normal(0, 0.02, points.shape)
    warm = solve(points, cells, law, boundary, fem_settings(), start=cold.displacement + noise)
    assert warm.converged
    assert warm.linear_iterations < cold.linear_iterations
    np.testing.assert_allclose(warm.displacement, cold.displacement, rtol=0, atol=1e-4)
    wild = np.random.default_rng(4).normal(0, 400, points.shape)
    far = solve(points, cells, law, boundary, fem_settings(max_iterations=6), start=wild)
    assert far.converged
    np.testing.assert_allclose(far.displacement, cold.displacement, rtol=0, atol=1e-4)


def test_few_corrections_of_a_start_are_returned_with_their_residual():
    points, cells, boundary = bent_block()
    law = material(len(cells))
    end = solve(points, cells, law, boundary, fem_settings(tolerance=1e-9)).displacement
    start = end + np.random.default_rng(4).normal(0, 0.4, points.shape)
    start[boundary.prescribed_nodes] = boundary.displacement(1.0)
    errors = []
    for count in (0, 1, 2):
        options = fem_settings(max_iterations=count, restart=False, tolerance=1e-12)
        result = solve(points, cells, law, boundary, options, start=start)
        assert not result.converged
        assert "residual" in result.reason
        errors.append(np.abs(result.displacement - end).max())
    assert errors[0] > 1.5 * errors[1] > 3 * errors[2]


def test_failure_is_reported_with_the_last_equilibrium():
    points, cells, _ = bent_block()
    ends = np.flatnonzero((points[:, 0] == 0) | (points[:, 0] == 40))
    crush = np.where(points[ends, :1] == 40, [-60.0, 0, 0], 0.0)  # one end pushed out through the other
    law = uniform(len(cells))
    result = solve(points, cells, law, BoundaryConditions(ends, crush), fem_settings(time_limit=10))
    assert not result.converged
    assert "increment" in result.reason or "time" in result.reason
    assert 0 < result.fraction < 40 / 60
    assert result.min_jacobian > 0
    assert np.isfinite(result.displacement).all()
    np.testing.assert_allclose(result.displacement[ends], result.fraction * crush, rtol=0, atol=1e-12)


def test_limits_of_time_and_of_work_stop_the_solver():
    points, cells, boundary = bent_block()
    result = solve(points, cells, uniform(len(cells)), boundary, fem_settings(time_limit=1e-9))
    assert not result.converged and result.fraction == 0
    assert result.reason == "time limit of 1e-09 s reached"
    enough = solve(points, cells, uniform(len(cells)), boundary, fem_settings(tolerance=1e-9))
    result = solve(points, cells, uniform(len(cells)), boundary, fem_settings(tolerance=1e-9, max_systems=3))
    assert enough.converged and not result.converged and result.reason.startswith("3 linear systems")
    options = fem_settings(max_iterations=1, min_increment=0.3, tolerance=1e-14)
    result = solve(points, cells, uniform(len(cells)), boundary, options)
    assert not result.converged
    assert "1 Newton iterations" in result.reason


def test_no_solve_is_limited_in_time_by_default():
    assert FemSettings.time_limit == fem_settings().time_limit == np.inf


@pytest.mark.parametrize("name", ["config", "quick", "paper"])
def test_no_configuration_limits_a_solve_in_time(name):
    """What is solved would depend on how busy the machine is."""
    assert "time_limit" not in (ROOT / f"config/{name}.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("fixed", [[0], [0, 1]])
def test_a_loose_mesh_is_refused(fixed):
    points, cells = box((9, 6, 6), (3, 2, 2))
    boundary = BoundaryConditions(np.array(fixed), np.zeros((len(fixed), 3)))
    with pytest.raises(InputError, match="free to move"):
        solve(points, cells, uniform(len(cells)), boundary, fem_settings())


def test_a_second_piece_that_nothing_holds_is_refused():
    points, cells, boundary = bent_block()
    both_points = np.vstack([points, points + [100, 0, 0]])
    both_cells = np.vstack([cells, cells + len(points)])
    with pytest.raises(InputError, match=f"piece of {len(points)}"):
        solve(both_points, both_cells, uniform(len(both_cells)), boundary, fem_settings())


def test_points_outside_every_cell_stay():
    points, cells, boundary = bent_block()
    more = np.vstack([points, [[99.0, 99, 99]]])
    alone = solve(points, cells, uniform(len(cells)), boundary, fem_settings())
    result = solve(more, cells, uniform(len(cells)), boundary, fem_settings())
    np.testing.assert_allclose(result.displacement[:-1], alone.displacement, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(result.displacement[-1], 0)


@pytest.mark.parametrize(
    "boundary",
    [
        BoundaryConditions(np.array([0, 0]), np.zeros((2, 3))),
        BoundaryConditions(np.array([0, 999999]), np.zeros((2, 3))),
        BoundaryConditions(np.array([0, 1]), np.full((2, 3), np.nan)),
        BoundaryConditions(np.array([0, 1]), np.zeros((3, 3))),
    ],
)
def test_bad_boundary_conditions_are_refused(boundary):
    points, cells, _ = bent_block()
    with pytest.raises(InputError):
        solve(points, cells, uniform(len(cells)), boundary, fem_settings())


PRINT_FIELD = """
import hashlib, sys
sys.path[:0] = sys.argv[1:]
import numpy as np
from scipy.spatial import Delaunay
from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.problems import box
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.settings import SolverSettings
from pinnochio.mechanics.solvers.newton import solve
points = np.random.default_rng(0).uniform(0, 20, (250, 3))
cells = Delaunay(points).simplices
volume = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]])
cells = np.where(volume[:, None] > 0, cells, cells[:, [1, 0, 2, 3]])[np.abs(volume) > 4]
ends = np.flatnonzero((points[:, 0] < 4) | (points[:, 0] > 16))
moved = np.where(points[ends, :1] > 16, [0.5, 0, 1.0], 0.0)
law = neo_hookean(np.ones(len(cells)), {1: 5.0}, 0.49)
limits = {"increments": 2, "tolerance": 1e-6, "max_iterations": 30, "max_systems": 300}
settings = SolverSettings(volumetric="patch", linear_solver="auto", **limits)
for _ in range(2):
    result = solve(points, cells, law, BoundaryConditions(ends, moved), settings)
    assert result.converged, result.reason
    print(hashlib.sha256(result.displacement.tobytes()).hexdigest())
"""


def test_same_bytes_within_and_across_processes():
    library = str(Path(pinnochio.__file__).parent.parent)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    runs = [
        subprocess.run(
            [sys.executable, "-c", PRINT_FIELD, library], env=environment, capture_output=True, text=True, check=True
        ).stdout.split()
        for _ in range(2)
    ]
    assert len(runs[0]) == 2
    assert len(set(runs[0] + runs[1])) == 1
