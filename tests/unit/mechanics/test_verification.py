"""The solver against closed forms, boundary-value problems in one variable, quadratic elements and felupe."""

from functools import cache

import felupe
import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.sliding import SlidingSet
from pinnochio.mechanics.elements.materials import lame
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, Elements
from pinnochio.mechanics.problems import box, uniform
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.plans.plan import RigidMotion
from tests.helpers.settings import fem_settings
from tests.helpers.solids import both, extruded, plane, solved, sphere

DEFAULT = VOLUMETRIC[0]


# ---- inflation of a thick sphere

INSIDE, OUTSIDE, INFLATED = 10.0, 20.0, 16.0  # mm; the last is where the inner radius goes


def half_sphere(n):
    """Points of a unit half sphere, z >= 0, from the octahedron with n intervals to an edge, and its triangles."""
    steps = np.arange(-n, n + 1)
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[np.abs(points).sum(axis=1) == n]
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices
    upper = points[:, 2] >= 0
    return points[upper], (np.cumsum(upper) - 1)[faces[upper[faces].all(axis=1)]]


def inflated(poisson, volumetric, n=13, layers=10):
    """Pressure inside (kPa), rest radii (n,) and reached radii (n,) of the inflated half sphere; z = 0 slides."""
    surface, triangles = half_sphere(n)
    count = len(surface)
    points, cells = extruded(np.geomspace(INSIDE, OUTSIDE, layers + 1)[:, None, None] * surface, triangles)
    rim = np.flatnonzero(points[:, 2] == 0)
    cut = SlidingSet(rim[rim >= count], *plane([0, 0, 1], np.zeros(3), half=60.0, step=3.0), RigidMotion().fraction)
    boundary = BoundaryConditions(np.arange(count), (INFLATED - INSIDE) * surface, [cut])
    result, force = solved(points, cells, boundary, poisson, volumetric)
    # A pressure p on the polyhedron inside does the work p dV, and V grows with the cube of the radius.
    volume = np.abs(np.linalg.det(INFLATED * surface[triangles])).sum() / 6
    pressure = (force[:count] * surface).sum() / (3 * volume / INFLATED)
    return pressure, np.linalg.norm(points, axis=1), np.linalg.norm(points + result.displacement, axis=1)


@cache
def shell_solution(poisson):
    """Radius r(R) and pressure of the inflated shell from the equilibrium of the compressible law.

    dP_r/dR + 2 (P_r - P_t)/R = 0 with P_i = mu (l_i - 1/l_i) + lam ln J / l_i, l_r = r', l_t = r/R, J = l_r l_t^2;
    r(INSIDE) is prescribed and P_r(OUTSIDE) = 0. The pressure is -P_r / l_t^2 inside (Cauchy).
    """
    mu, lam = lame(5.0, poisson)

    def nominal(stretch, log):
        return mu * (stretch - 1 / stretch) + lam * log / stretch

    def slope(rest, state):
        radius, along = state
        across = radius / rest
        log = np.log(along * across**2)
        # P_r depends on r' and on r/R, whose derivative is (r' - r/R)/R.
        stiffness = mu * (1 + along**-2) + lam * (1 - log) / along**2
        pull = 2 * (nominal(along, log) - nominal(across, log)) + 2 * lam * (along - across) / (along * across)
        return np.stack([along, -pull / (rest * stiffness)])

    def ends(inner, outer):
        across = outer[0] / OUTSIDE
        return np.array([inner[0] - INFLATED, nominal(outer[1], np.log(outer[1] * across**2))])

    rest = np.linspace(INSIDE, OUTSIDE, 41)
    guess = np.cbrt(rest**3 + INFLATED**3 - INSIDE**3)
    profile = solve_bvp(slope, ends, rest, np.stack([guess, (rest / guess) ** 2]), tol=1e-8, max_nodes=20000)
    assert profile.success
    radius, along = profile.sol(INSIDE)
    across = radius / INSIDE
    return lambda rest: profile.sol(rest)[0], -nominal(along, np.log(along * across**2)) / across**2


def incompressible_pressure():
    """Of W = mu/2 (I1 - 3): p = int 2 mu (l^2 - l^-4) dr/r with l = r/R; r^3 - R^3 is the same everywhere, so
    dr/r = dl / (l (1 - l^3)) and p = mu/2 [4/l + 1/l^4] from the inner stretch to the outer one.
    """
    mu, _ = lame(5.0, 0.4999)
    inner = INFLATED / INSIDE
    outer = np.cbrt(OUTSIDE**3 + INFLATED**3 - INSIDE**3) / OUTSIDE
    return mu / 2 * (4 / outer + outer**-4 - 4 / inner - inner**-4)


def test_the_shell_equation_tends_to_the_incompressible_closed_form():
    radius, pressure = shell_solution(0.4999)
    assert pressure == pytest.approx(incompressible_pressure(), rel=5e-4)
    assert radius(OUTSIDE) == pytest.approx(np.cbrt(OUTSIDE**3 + INFLATED**3 - INSIDE**3), rel=2e-4)


BETWEEN = [pytest.param(poisson, marks=pytest.mark.full) for poisson in (0.45, 0.49)]


@pytest.mark.parametrize("poisson", [0.3, *BETWEEN, 0.4999])
def test_inflated_sphere(poisson):
    pressure, rest, reached = inflated(poisson, DEFAULT)
    radius, expected = shell_solution(poisson)
    assert pressure == pytest.approx(expected, rel=0.01)
    if poisson == 0.4999:
        assert pressure == pytest.approx(incompressible_pressure(), rel=0.01)
    outside = rest > OUTSIDE - 1e-9
    rise = radius(OUTSIDE) - OUTSIDE
    assert reached[outside].mean() - OUTSIDE == pytest.approx(rise, rel=0.003)
    assert np.abs(reached - radius(rest)).max() < 0.02 * rise


# ---- torsion


def column(radius, length, rings, layers):
    """Points and cells of a round column along z, of 6, 12, ... nodes in its rings."""
    disc = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        turn = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        disc.append(ring / rings * np.column_stack([np.cos(turn), np.sin(turn)]))
    disc = np.vstack(disc)
    heights = np.linspace(0, length, layers + 1)
    sections = np.stack([np.column_stack([radius * disc, np.full(len(disc), z)]) for z in heights])
    return extruded(sections, Delaunay(disc).simplices)


def twist(points, rate, z=None):
    """Displacement (n, 3) of points that turn about z by `rate` (rad/mm) times their z, or times one z for all."""
    turned = Rotation.from_rotvec(np.outer(rate * (points[:, 2] if z is None else z), [0, 0, 1]))
    return turned.apply(points) - points


def torque(points, displacement, force):
    return np.cross(points + displacement, force)[:, 2].sum()


def twisted(volumetric, poisson=0.4999):
    """Torque (mN mm), axial force (mN), polar moment (mm4), rate (rad/mm) and largest error of the field (mm)."""
    rate = np.deg2rad(24) / 8
    points, cells = column(10.0, 8.0, 10, 8)
    ends = np.flatnonzero((points[:, 2] == 0) | (points[:, 2] == 8))
    boundary = BoundaryConditions(ends, lambda t: twist(points[ends], t * rate))
    result, force = solved(points, cells, boundary, poisson, volumetric)
    top = points[:, 2] == 8
    # The polygon's radius is that of the circle with the same polar moment pi a^4/2.
    hull = points[top][ConvexHull(points[top, :2]).vertices, :2]
    after = np.roll(hull, -1, axis=0)
    cross, square = hull[:, 0] * after[:, 1] - hull[:, 1] * after[:, 0], (hull**2 + hull * after + after**2).sum(axis=1)
    polar = (cross * square).sum() / 12
    moved = result.displacement
    error = np.abs(moved - twist(points, rate)).max()
    return torque(points[top], moved[top], force[top]), force[top, 2].sum(), polar, rate, error


def test_twisted_round_column():
    """Pure torsion is in equilibrium in every incompressible solid (Rivlin 1948). With b = F F' and a free side,
    s_tz = mu rate r and s_zz = s_rr = mu rate^2 (r^2 - a^2)/2: the torque is mu rate pi a^4/2, the axial force
    -mu rate^2 pi a^4/4; a column that may not shorten pushes its ends apart (Poynting)."""
    mu, _ = lame(5.0, 0.4999)
    moment, axial, polar, rate, error = twisted(DEFAULT)
    assert moment == pytest.approx(mu * rate * polar, rel=0.03)
    assert axial == pytest.approx(-mu * rate**2 * polar / 2, rel=0.1)
    assert error < 0.03  # of 4.2 mm


@both
def test_square_column_twisted_far(volumetric):
    """120 degrees; the torque is the derivative of the energy by the angle."""
    points, cells = box((10, 10, 40), (4, 4, 14))
    points -= [5, 5, 0]
    ends = np.flatnonzero((points[:, 2] == 0) | (points[:, 2] == 40))
    top = points[:, 2] == 40
    law = uniform(len(cells), 0.49)
    energies, step, start = [], np.deg2rad(0.5), None
    for angle in np.deg2rad(120) + step * np.array([-1, 1, 0]):
        boundary = BoundaryConditions(ends, lambda t, a=angle: twist(points[ends], t * a / 40))
        options = fem_settings(volumetric=volumetric, increments=4, tolerance=1e-8)
        result = solve(points, cells, law, boundary, options, start=start)
        assert result.converged, result.reason
        assert result.min_jacobian > 0.2
        start = result.displacement
        energy, force, _ = Elements.build(points, cells, law, volumetric).evaluate(start)
        energies.append(energy)
    moment = torque(points[top], start[top], force[top])
    assert moment == pytest.approx((energies[1] - energies[0]) / (2 * step), rel=1e-4)
    assert np.abs(force[top].sum(axis=0) + force[points[:, 2] == 0].sum(axis=0)).max() < 1e-6 * abs(moment)


# ---- Cook's membrane


def cook(steps):
    """Cook's membrane (48 x 44 mm, right side 16 mm high), 10 mm thick; left face fixed, right face lifted by 6 mm."""
    points, cells = box((48, 1, 10), steps)
    x, share = points[:, 0], points[:, 1].copy()
    low, high = 44 * x / 48, 44 + 16 * x / 48
    points[:, 1] = low + share * (high - low)
    ends = np.flatnonzero((x == 0) | (x == 48))
    return points, cells, BoundaryConditions(ends, np.where(x[ends, None] == 48, [0, 6.0, 0], 0.0))


# Lift (mN) at the right face by Taylor-Hood elements on 10 x 9 x 2 cubes (`mixed_newton.py`, last in `7c2d786`).
COOK = {0.3: 43.295128, 0.4999: 42.387329}


@pytest.mark.parametrize("poisson", COOK)
def test_cook_membrane(poisson):
    points, cells, boundary = cook((16, 14, 4))
    _, force = solved(points, cells, boundary, poisson)
    reference = COOK[poisson]
    lift = force[points[:, 0] == 48, 1].sum()
    assert reference < lift < 1.035 * reference  # both are minima of the energy, the reference in the richer space
    if poisson > 0.49:
        _, force = solved(points, cells, boundary, poisson, "p1")
        assert force[points[:, 0] == 48, 1].sum() > 1.25 * reference


# ---- order of convergence

# u = grad phi with phi harmonic has div u = 0 and no Laplacian: it solves Navier's equations whatever nu.
SMOOTH = {
    "xyz": lambda x, y, z: np.stack([y * z, x * z, x * y], axis=-1),
    "x3-3xy2": lambda x, y, z: np.stack([3 * x**2 - 3 * y**2, -6 * x * y, 0 * z], axis=-1),
    "exp": lambda x, y, z: (
        np.exp(x)[..., None]
        * np.stack(
            [
                np.cos(0.6 * y) * np.cos(0.8 * z),
                -0.6 * np.sin(0.6 * y) * np.cos(0.8 * z),
                -0.8 * np.cos(0.6 * y) * np.sin(0.8 * z),
            ],
            axis=-1,
        )
    ),
}
AMPLITUDE = 1e-5  # so small that the linear theory holds to 1e-4 of the error


def l2_error(points, cells, displacement, exact):
    """Root mean square over the volume, by the four-point rule."""
    at = np.full((4, 4), 0.1381966011250105) + np.eye(4) * 0.4472135954999579
    places, field = (np.einsum("qa,eai->eqi", at, values[cells]) for values in (points, displacement))
    volume = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]])
    square = ((field - exact(*np.moveaxis(places, -1, 0))) ** 2).sum(axis=2).mean(axis=1)
    return np.sqrt((volume * square).sum() / volume.sum())


def order(field, poisson, volumetric, steps=(6, 12)):
    errors = []
    for count in steps:
        points, cells = box((2, 2, 2), (count,) * 3, jitter=0.15)
        skin = np.flatnonzero(((points == 0) | (points == 2)).any(axis=1))
        boundary = BoundaryConditions(skin, AMPLITUDE * SMOOTH[field](*points[skin].T))
        result, _ = solved(points, cells, boundary, poisson, volumetric, 1e-8, increments=1)
        errors.append(l2_error(points, cells, result.displacement / AMPLITUDE, SMOOTH[field]))
    return np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])


@both
@pytest.mark.parametrize("field", SMOOTH)
def test_second_order_in_the_edge(field, volumetric):
    assert order(field, 0.3, volumetric) > 1.9


@pytest.mark.parametrize("poisson", [0.49, 0.4999])
@pytest.mark.parametrize("field", SMOOTH)
def test_second_order_without_locking(field, poisson):
    assert order(field, poisson, DEFAULT) > 1.85


@pytest.mark.parametrize("field", SMOOTH)
def test_plain_tetrahedra_lose_the_order_by_locking(field):
    assert order(field, 0.4999, "p1") < 1.65


# ---- objectivity and symmetry


def bent_over_a_ball(turn, shift, volumetric, noise=0.6):
    """Displacement (n, 3) of a block bent between its ends over a ball that moves, all of it turned (3, 3) and shifted.

    A turn with determinant -1 mirrors the problem, with the cells in the same order.
    """
    points, cells = box((40, 20, 15), (8, 4, 3))
    ends = np.flatnonzero((points[:, 0] == 0) | (points[:, 0] == 40))
    under = np.setdiff1d(np.flatnonzero(points[:, 2] == 0), ends)
    right = points[ends, 0] == 40
    points += np.random.default_rng(0).uniform(-noise, noise, points.shape)
    turning = RigidMotion.from_degrees([5, 20, 0], [-3.0, 2.0, -6.0], [40, 10, 7])
    lift = RigidMotion.from_degrees([0, 10, 30], [1.0, -0.5, 2.0], [20, 10, -40])
    ball, normals = sphere(40, 6000)
    ball = ball + [20, 10, -40]

    def mapped(motion):
        return RigidMotion(turn @ motion.rotation @ turn.T, turn @ motion.translation, turn @ motion.pivot + shift)

    def prescribed(fraction):
        return np.where(right[:, None], turning.fraction(fraction).displacement(points[ends]), 0.0) @ turn.T

    sliding = SlidingSet(under, ball @ turn.T + shift, normals @ turn.T, lambda t: mapped(lift.fraction(t)))
    ordered = cells if np.linalg.det(turn) > 0 else cells[:, [0, 2, 1, 3]]
    boundary = BoundaryConditions(ends, prescribed, [sliding])
    result, _ = solved(points @ turn.T + shift, ordered, boundary, 0.49, volumetric, 1e-11)
    assert np.abs(result.displacement).max() > 6
    return result.displacement


@pytest.mark.parametrize(("volumetric", "noise"), [("p1", 0.6), (DEFAULT, 0.6), (DEFAULT, 0.0)])
def test_a_turned_problem_has_the_turned_solution(volumetric, noise):
    """Without noise many elements of the mesh are equally near to a patch."""
    turn, shift = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix(), np.array([30.0, -400, 70])
    expected = bent_over_a_ball(np.eye(3), np.zeros(3), volumetric, noise) @ turn.T
    np.testing.assert_allclose(bent_over_a_ball(turn, shift, volumetric, noise), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("volumetric", ["p1", DEFAULT])
def test_a_mirrored_problem_has_the_mirrored_solution(volumetric):
    mirror = np.diag([1.0, -1.0, 1.0])
    expected = bent_over_a_ball(np.eye(3), np.zeros(3), volumetric) @ mirror
    np.testing.assert_allclose(bent_over_a_ball(mirror, np.zeros(3), volumetric), expected, rtol=0, atol=1e-8)


@both
def test_a_symmetric_problem_has_a_symmetric_solution(volumetric):
    """On a mesh that is its own mirror image. Patches are not, so the default is symmetric to its error alone, which
    is largest, and does not shrink, at single nodes beside the edges where the boundary condition jumps: hence rms."""
    points, cells = box((20, 20, 15), (8, 8, 6), jitter=0.15)
    middle = points[:, 0] == 0
    image = np.where(middle, np.arange(len(points)), len(points) + np.cumsum(~middle) - 1)
    whole = np.vstack([points, points[~middle] * [-1, 1, 1]])
    partner = np.concatenate([image, np.flatnonzero(~middle)])
    both_halves = np.vstack([cells, image[cells[:, [0, 2, 1, 3]]]])
    ends = np.flatnonzero(np.abs(whole[:, 0]) == 20)
    moved = np.where(whole[ends, :1] > 0, [-3.0, 2.0, 4.0], [3.0, 2.0, 4.0])
    fixed = np.flatnonzero((whole[:, 2] == 0) & (np.abs(whole[:, 0]) < 10))
    boundary = BoundaryConditions(np.append(ends, fixed), np.vstack([moved, np.zeros((len(fixed), 3))]))
    result, _ = solved(whole, both_halves, boundary, 0.49, volumetric, 1e-11)
    asymmetry = result.displacement - result.displacement[partner] * [-1, 1, 1]
    rms = np.sqrt((asymmetry**2).sum(axis=1).mean())
    assert rms < (1e-8 if volumetric == "p1" else 0.08)  # mm, of 5.4


# ---- stress


def random_gradients(count):
    """Deformation gradients (count, 3, 3) with J from 0.4 to 2.5."""
    gradients = np.eye(3) + np.random.default_rng(7).normal(0, 0.35, (20 * count, 3, 3))
    j = np.linalg.det(gradients)
    return gradients[(j > 0.4) & (j < 2.5)][:count]


def element_stress(f, volumetric, poisson):
    """First Piola-Kirchhoff stress (3, 3) in kPa of a single tetrahedron, the mean of force times place: div P = 0."""
    points, cells = np.array([[0, 0, 0], [3.0, 0.5, 0.2], [0.4, 4, -1], [-0.5, 0.3, 5]]), np.array([[0, 1, 2, 3]])
    elements = Elements.build(points, cells, uniform(1, poisson), volumetric)
    _, force, least = elements.evaluate(points @ (f - np.eye(3)).T)
    assert least == pytest.approx(np.linalg.det(f))
    return force.T @ points / elements.volumes[0]


@both
@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999])
def test_stress_of_random_strain_is_that_of_febio_and_of_felupe(volumetric, poisson):
    """FEBio User's Manual, neo-Hookean: Cauchy stress mu/J (b - I) + lam ln J / J I; felupe's own code for P."""
    mu, lam = lame(5.0, poisson)
    peer = felupe.NeoHookeCompressible(mu=mu, lmbda=lam)
    for f in random_gradients(50):
        j = np.linalg.det(f)
        nominal = element_stress(f, volumetric, poisson)
        cauchy = mu / j * (f @ f.T - np.eye(3)) + lam * np.log(j) / j * np.eye(3)
        scale = np.abs(nominal).max()
        np.testing.assert_allclose(nominal @ f.T / j, cauchy, rtol=0, atol=1e-11 * np.abs(cauchy).max())
        theirs = peer.gradient([f[:, :, None, None], None])[0][:, :, 0, 0]
        np.testing.assert_allclose(nominal, theirs, rtol=0, atol=1e-11 * scale)
