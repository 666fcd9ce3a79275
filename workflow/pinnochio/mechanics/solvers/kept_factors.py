"""Many plans of one patient: quasi-Newton steps on the factors of the stiffness at rest, which are kept.

Mesh, material, constrained nodes and the tension of surfaces are the patient's, motions and dead forces alone the
plan's. A plan begins with its linear field
and goes on by L-BFGS (Nocedal 1980), one force and one solution by the kept factors an iteration. Two things make that
few iterations [X]:

* the factors are warped: loads are pulled back, and motions pushed forward, by the mean deformation gradient G of each
  node, scaled to determinant 1. A field that keeps volume at rest keeps it when pushed forward so (Piola), so that the
  stiff and the soft fields of nearly incompressible tissue stay apart. Of a sliding node, G takes the tangents of the
  bone's surface at rest to those where the node is now.
* patches with a hard element (squeezed or stretched far), and those that touch sliding nodes, are brought to
  equilibrium by Newton's method before each step: there the stiffness has little to do with that at rest.

What does not converge so, or may have found another equilibrium than a small motion leads to, goes on in increments of
the load; what fails even then is solved by Newton's method from rest, as `newton.solve` does.
"""

import copy
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from pinnochio.compiled import compiled
from pinnochio.geometry.mesh_topology import edges_of
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.constraints import Constraints
from pinnochio.mechanics.boundary.loads import Loads, OuterForces
from pinnochio.mechanics.boundary.sliding import SlidingNodes
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import Elements, least_reaction, lumped
from pinnochio.mechanics.settings import SolverSettings
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.local_equilibrium import LocalEquilibrium, touching
from pinnochio.mechanics.solvers.newton import SolveResult, solve

MEMORY = 10  # pairs of steps and changes of the force that are kept
# An element is hard below this volume ratio, or above this I1 = tr F'F, 3 at rest.
HARD_RATIO, HARD_STRETCH = 0.5, 8.0
LOOSE = 0.1  # force left in the hard patches, over that outside, before a step
# A field may be another equilibrium than small loads lead to where a node, from where the linear field puts it, goes by
# so many mean edges beside the mean of its neighbours: a tip of the mesh that one element alone holds has two [X].
STRAY = 1.0
# So does a node that strays by LEAST_STRAY edges and slid by SLIDE mm, into another hollow of its bone, or round a rim
# of it, to where the cosine between the surface's normals is below RIM. Of 522 sampled plans of 13 patients 63 are so,
# 10 of them in another equilibrium; of those that are not, one [X].
LEAST_STRAY, SLIDE, RIM = 0.55, 4.0, 0.4
# Of the next step, what may still come. Where a point of the face goes on by steps that hardly shrink, three steps were
# too few on 2 to 4 % of 200 sampled plans; rates of these steps do no better at the same price [X:
# docs/explanation/accuracy.md].
ESTIMATE = 6.0
WILD = -2  # a step to where an element has a smaller J is halved at once
ITERATIONS = 60  # after so many at one load it counts as failed
PATIENCE, FAR = 8, 0.3  # so many iterations that leave more than this residual promise nothing [X]
# Share of the load in the first increment, where the whole fails at once, and the least one.
INCREMENT, LEAST_INCREMENT = 0.25, 1 / 16


class Iterate(NamedTuple):
    """A displacement (n, 3) mm, its energy, least J, local axes (s, 3, 3) of the sliding nodes, force
    (n, 3) mN in local axes, and the norm of the force on the constrained unknowns."""

    u: np.ndarray
    energy: float
    least: float
    axes: np.ndarray
    force: np.ndarray
    reaction: float


@dataclass
class Trajectory:
    """How one plan is solved. outer: its forces beside those of the elements; held: its sliding nodes, target (p, 3)
    mm: where its prescribed nodes go, both at the fraction of the load that it is at; part: its hard patches."""

    constraints: Constraints
    outer: OuterForces
    held: SlidingNodes | None = None
    target: np.ndarray | None = None
    fraction: float = 0.0
    part: LocalEquilibrium | None = None
    iterate: Iterate | None = None
    residual: float = np.inf
    iterations: int = 0
    reason: str = ""
    history: list[dict] = field(default_factory=list)


class KeptFactors:
    """The factors of one mesh with one set of constrained nodes, for any number of motions.

    points (n, 3) mm, cells (m, 4). The first boundary tells the nodes and the bones that they slide on. rest: the
    factors, where they are there already; :meth:`close` releases them all the same. watched (k, n): from values at the
    nodes to those at the points where settings.accuracy counts; without it plans are solved to settings.tolerance.
    """

    def __init__(
        self,
        points,
        cells,
        material: Material,
        boundary: BoundaryConditions,
        settings: SolverSettings,
        rest: ElasticSolver | None = None,
        watched: sparse.sparray | None = None,
    ):
        self._watched = watched
        self._points, self._cells, self._material, self._settings = np.asarray(points, float), cells, material, settings
        self._rest = rest or ElasticSolver(
            points, cells, material, boundary, settings.volumetric, settings.linear_solver, True
        )
        self._elements, self._constraints = self._rest.elements, self._rest.constraints
        self._end = np.inf  # of the time that a call may take
        self._gradients = mean_gradients(self._elements)
        self._beside = beside(self._elements)
        elements, nodes = self._elements, self._constraints.sliding.nodes
        used = np.zeros(len(self._points), bool)
        used[elements.cells] = True
        self._free = used[:, None] & ~self._constraints.constrained
        self._shell = touching(elements, nodes)

    def of(self, material: Material, loads: Loads | None) -> "KeptFactors":
        """The same mesh of another material under another tension: near enough to these, the factors serve it too."""
        other = copy.copy(self)
        other._material, other._rest = material, self._rest.of(material, loads)
        other._elements = other._rest.elements
        return other

    def solve(self, boundaries: Sequence[BoundaryConditions], starts: np.ndarray | None = None) -> list[SolveResult]:
        """The solution of each boundary condition, which differs from the first one in motion and dead forces alone.

        All advance together, so that their loads meet the factors together; a plan that fails does not stop others.
        starts (k, n, 3) mm: fields at full load to begin with, if not the linear ones.
        """
        began = time.perf_counter()
        trajectories = [self._trajectory(item) for item in boundaries]
        self._end = began + self._settings.time_limit * len(trajectories)
        self._advance(trajectories, starts)
        share = (time.perf_counter() - began) / max(len(trajectories), 1)
        results = []
        for boundary, trajectory in zip(boundaries, trajectories, strict=True):
            if not trajectory.reason:
                results.append(self._result(trajectory, share))
                continue
            result = solve(self._points, self._cells, self._material, boundary, self._settings)
            results.append(replace(result, seconds=result.seconds + share))
        return results

    def close(self) -> None:
        """Release the factors."""
        self._rest.close()

    def _trajectory(self, boundary: BoundaryConditions) -> Trajectory:
        forces = boundary.loads.forces if boundary.loads else None
        return Trajectory(self._constraints.under(boundary), self._rest.outer.under(forces))

    def _advance(self, trajectories: Sequence[Trajectory], starts: np.ndarray | None) -> None:
        if not trajectories:
            return
        if starts is None:
            starts = self._rest.spread(np.stack([trajectory.constraints.motions() for trajectory in trajectories]))
            if any(trajectory.outer.act for trajectory in trajectories):
                starts += self._rest.under(np.stack([trajectory.outer.forces for trajectory in trajectories]))
        walks = [self._walk(trajectory, start) for trajectory, start in zip(trajectories, starts, strict=True)]
        numbers, answers = list(range(len(trajectories))), [None] * len(trajectories)
        while numbers:
            pairs = zip(numbers, answers, strict=True)
            loads = {at: self._sent(walks[at], trajectories[at], answer) for at, answer in pairs}
            numbers = [number for number in numbers if loads[number] is not None]
            if numbers:
                answers = self._rest.respond(np.stack([loads[number] for number in numbers]))
                answers = answers.reshape(len(numbers), -1)

    @staticmethod
    def _sent(walk: Generator, trajectory: Trajectory, answer: np.ndarray | None) -> np.ndarray | None:
        """The next load of a plan, None at its end; what goes wrong in it is its own reason and stops no other."""
        try:
            return walk.send(answer)
        except StopIteration:
            return None
        except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
            trajectory.reason = f"{type(error).__name__}: {error}"
            return None

    def _walk(self, trajectory: Trajectory, linear) -> Generator[np.ndarray, np.ndarray, None]:
        """One plan to equilibrium, linear (n, 3) mm its linear field; gives loads (f,) and is sent what they cause.

        The whole load at once; if that fails in increments, which are halved as often as they fail, down to a limit.
        """
        u, done, share = np.zeros_like(linear), 0.0, 1.0
        try:
            while done < 1:
                trajectory.fraction, trajectory.reason = min(done + share, 1.0), ""
                trajectory.target = trajectory.constraints.boundary.displacement(trajectory.fraction)
                trajectory.held = trajectory.constraints.sliding.at(trajectory.fraction)
                yield from self._balance(trajectory, u + (trajectory.fraction - done) * linear, share > LEAST_INCREMENT)
                if not trajectory.reason:
                    u, done = trajectory.iterate.u, trajectory.fraction
                    continue
                share = min(share / 2, INCREMENT)
                if share < LEAST_INCREMENT:
                    return
                self._forget(trajectory)
        finally:
            self._forget(trajectory)

    @staticmethod
    def _forget(trajectory: Trajectory) -> None:
        if trajectory.part is not None:
            trajectory.part.close()
            trajectory.part = None

    def _balance(self, trajectory: Trajectory, start, wary: bool) -> Generator[np.ndarray, np.ndarray, None]:
        """From a field (n, 3) mm, whose sliding nodes are put back, to equilibrium at the plan's share of the load.

        wary: refuse what may be another equilibrium; in the least increments it is the one that they lead to.
        """
        pairs: list[tuple] = []
        tolerance = self._settings.tolerance if trajectory.fraction == 1 else self._settings.loose
        normals = trajectory.held.project(start)[:, 0]
        iterate = self._settled(trajectory, start.copy())
        for count in range(ITERATIONS):
            gradient = iterate.force[self._free]
            trajectory.iterate, trajectory.residual = iterate, self._residual(iterate)
            trajectory.history.append(
                {
                    "fraction": trajectory.fraction,
                    "residual": trajectory.residual,
                    "energy": iterate.energy,
                    "min_jacobian": iterate.least,
                }
            )
            if trajectory.residual <= self._settings.loose:
                trajectory.reason = self._doubt(start, normals, iterate, wary)
            if count == PATIENCE and trajectory.residual > FAR:
                trajectory.reason = f"{count} iterations left a residual of {trajectory.residual:.1e}"
            if time.perf_counter() > self._end:
                trajectory.reason = f"time limit of {self._settings.time_limit:g} s reached"
            if trajectory.residual <= tolerance or trajectory.reason:
                return
            direction = yield from self._direction(iterate, gradient, pairs)
            motion = self._motion(iterate, direction)
            if self._near_enough(trajectory, motion):
                trajectory.reason = self._doubt(start, normals, iterate, wary)
                return
            new = self._searched(trajectory, iterate, motion, direction @ gradient)
            trajectory.iterations += 1
            if new is None:
                trajectory.reason = f"the line search stagnated at a residual of {trajectory.residual:.1e}"
                return
            step = self._constraints.local(new.u - iterate.u, new.axes)[self._free]
            change = new.force[self._free] - gradient
            if step @ change > 1e-12 * np.linalg.norm(step) * np.linalg.norm(change):
                pairs = [*pairs, (step, change, 1 / (step @ change))][-MEMORY:]
            iterate = new
        trajectory.reason = f"{ITERATIONS} iterations left a residual of {trajectory.residual:.1e}"

    def _near_enough(self, trajectory: Trajectory, motion: np.ndarray) -> bool:
        """Whether the whole load is on and the change that is still to come is below the accuracy, by the estimate that
        the next step (n, 3) mm is."""
        if self._watched is None or trajectory.fraction < 1:
            return False
        return ESTIMATE * np.linalg.norm(self._watched @ motion, axis=1).max() <= self._settings.accuracy

    def _doubt(self, start, normals, iterate: Iterate, wary: bool) -> str:
        """Why a point near equilibrium does not serve, or ""."""
        if self._settings.barrier and not iterate.least > 0:
            return "elements are inside out"
        return self._elsewhere(start, normals, iterate) if wary else ""

    def _elsewhere(self, start, normals, iterate: Iterate) -> str:
        """Why the point, from a start (n, 3) mm with these normals (s, 3), may be another equilibrium than the one that
        a small motion leads to, or ""."""
        way = iterate.u - start
        stray = np.linalg.norm(way - self._beside @ way, axis=1).max() / self._elements.edge
        if stray <= LEAST_STRAY:
            return ""
        if (normals * iterate.axes[:, 0]).sum(axis=1).min(initial=1.0) < RIM:
            return "a node slid round the rim of its bone"
        if np.linalg.norm(way[self._constraints.sliding.nodes], axis=1).max(initial=0) > SLIDE:
            return "a node slid far from where the linear field puts it"
        return "a node strayed from those beside it" if stray > STRAY else ""

    def _direction(self, iterate: Iterate, gradient, pairs) -> Generator[np.ndarray, np.ndarray, np.ndarray]:
        """Minus the product of the inverse Hessian that L-BFGS knows with the gradient (f,)."""
        q, shares = gradient.copy(), []
        for step, change, scale in reversed(pairs):
            shares.append(scale * (step @ q))
            q -= shares[-1] * change
        warp = self._warp(iterate)
        whole = np.zeros(self._free.shape)
        whole[self._free] = q
        whole[self._free] = yield np.einsum("nji,nj->ni", warp, whole)[self._free]
        q = np.einsum("nij,nj->ni", warp, whole)[self._free]
        for (step, change, scale), share in zip(pairs, reversed(shares), strict=True):
            q += (share - scale * (change @ q)) * step
        return -q

    def _warp(self, iterate: Iterate) -> np.ndarray:
        """Mean deformation gradient (n, 3, 3) at the nodes, of determinant 1, from axes at rest to those of now."""
        warp, mean = np.empty((len(iterate.u), 3, 3)), self._gradients
        _mean_deformation(mean.indptr, mean.indices, mean.data, iterate.u, warp)
        nodes = self._constraints.sliding.nodes
        warp[nodes] = iterate.axes @ warp[nodes] @ self._rest.frames.transpose(0, 2, 1)
        warp[nodes, 0, :] = warp[nodes, :, 0] = 0
        return warp

    def _motion(self, iterate: Iterate, direction) -> np.ndarray:
        """A direction (f,) as motion (n, 3) mm of the nodes."""
        motion = np.zeros(self._free.shape)
        motion[self._free] = direction
        nodes = self._constraints.sliding.nodes
        motion[nodes] = np.einsum("sij,si->sj", iterate.axes, motion[nodes])
        return motion

    def _searched(self, trajectory: Trajectory, iterate: Iterate, motion, slope: float) -> Iterate | None:
        """The state after a step along `motion` (n, 3) mm on which the energy falls, its hard patches in equilibrium.

        slope: of the energy along it. A step that turns elements inside out serves if these find their way out while
        the rest stays.
        """
        if not slope < 0:
            return None
        noise = self._elements.noise(iterate.energy)
        allowed = 0.0 if iterate.least > 0 and self._settings.barrier else -np.inf
        for halvings in range(20):
            step = 0.5**halvings
            new = self._settled(trajectory, iterate.u + step * motion, WILD)
            if new is not None and new.energy <= iterate.energy + 1e-4 * step * slope + noise and new.least > allowed:
                return new
        return None

    def _settled(self, trajectory: Trajectory, u, least: float = -np.inf) -> Iterate | None:
        """The admissible state next to `u`, which is taken over, with its hard patches in equilibrium; None if there an
        element has a J below `least`."""
        u[self._constraints.prescribed] = trajectory.target
        axes = trajectory.held.project(u)
        energy, force, state = self._elements.measure(u)
        if state[:, 0].min() < least:
            return None
        if trajectory.outer.act:
            loaded, pull = trajectory.outer.evaluate(u, trajectory.fraction)
            energy, force = energy + loaded, force + pull
        part = self._part(trajectory, state)
        if part is None:
            return self._iterate(u, energy, state[:, 0].min(), axes, force)
        outside = self._free & ~part.inside
        iterate = self._iterate(u, energy, 0.0, axes, force)
        least_goal = 0.3 * self._settings.tolerance * self._reaction(iterate)
        goal = max(LOOSE * np.linalg.norm(iterate.force[outside]), least_goal)
        done = part.settled(u, trajectory.held, axes, goal, trajectory.fraction)
        force[part.nodes] += done.force
        least = min(state[~part.touched[self._elements.patch], 0].min(initial=np.inf), done.least)
        return self._iterate(done.displacement, energy + done.energy, least, done.axes, force)

    def _part(self, trajectory: Trajectory, state) -> LocalEquilibrium | None:
        """The plan's hard patches, with those that became so; state (m, 2): J and I1 of the elements."""
        hard = np.zeros(len(self._elements.patch_volumes), bool)
        hard[self._elements.patch[(state[:, 0] < HARD_RATIO) | (state[:, 1] > HARD_STRETCH)]] = True
        known = self._shell if trajectory.part is None else trajectory.part.patches
        if (hard & ~known).any() or (trajectory.part is None and known.any()):
            nodes = np.zeros(len(self._points), bool)
            nodes[self._elements.cells[hard[self._elements.patch]]] = True
            wide = known | touching(self._elements, nodes)
            self._forget(trajectory)
            kind, barrier = self._settings.linear_solver, self._settings.barrier
            held = self._constraints.constrained, self._constraints.sliding.nodes
            trajectory.part = LocalEquilibrium(self._elements, *held, wide, trajectory.outer, kind, barrier)
        return trajectory.part

    def _iterate(self, u, energy: float, least: float, axes, force) -> Iterate:
        local = self._constraints.local(force, axes)
        return Iterate(u, energy, least, axes, local, float(np.linalg.norm(local[self._constraints.constrained])))

    def _reaction(self, iterate: Iterate) -> float:
        return max(iterate.reaction, least_reaction(self._elements, self._constraints.constrained.sum()))

    def _residual(self, iterate: Iterate) -> float:
        return float(np.linalg.norm(iterate.force[self._free]) / self._reaction(iterate))

    def _result(self, trajectory: Trajectory, seconds: float) -> SolveResult:
        iterate = trajectory.iterate
        return SolveResult(
            displacement=iterate.u,
            converged=True,
            reason="converged",
            history=[{"kind": "kept", "step": 1.0} | entry for entry in trajectory.history],
            min_jacobian=iterate.least,
            fraction=1.0,
            residual=trajectory.residual,
            violation=float(np.abs(trajectory.held.violation(iterate.u)).max(initial=0.0)),
            penetration=0.0,
            gap=0.0,
            increments=1,
            iterations=trajectory.iterations,
            factorizations=0,
            linear_iterations=trajectory.iterations,
            seconds=seconds,
            kept=True,
        )


def mean_gradients(elements: Elements) -> sparse.csr_array:
    """Displacement (n, 3) mm -> transposed mean displacement gradients by volume, (3n, 3), of the nodes."""
    cells, weighted = elements.cells, elements.volumes[:, None, None] * elements.gradients
    share = lumped(cells, 4 * elements.volumes, elements.nodes)
    rows = np.broadcast_to(3 * cells[:, :, None, None] + np.arange(3), (*cells.shape, 4, 3))
    columns = np.broadcast_to(cells[:, None, :, None], rows.shape)
    values = weighted[:, None] / share[cells][:, :, None, None]
    shape = 3 * elements.nodes, elements.nodes
    return sparse.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape)


def beside(elements: Elements) -> sparse.csr_array:
    """Nodal values (n, ...) -> mean of those at the neighbours of each node, (n, n)."""
    edges = edges_of(elements.cells)[0]
    ends = np.concatenate([edges, edges[:, ::-1]]).T
    near = sparse.csr_array((np.ones(len(ends[0])), ends), (elements.nodes, elements.nodes))
    return sparse.diags_array(1 / np.maximum(near.sum(axis=1), 1)) @ near


@compiled
def _mean_deformation(indptr, indices, data, u, mean):
    """Mean deformation gradients (n, 3, 3) of determinant 1 under u (n, 3) mm; indptr, indices, data: of
    :func:`mean_gradients`."""
    for n in range(len(mean)):
        g = mean[n]
        for j in range(3):
            x, y, z = 0.0, 0.0, 0.0
            for k in range(indptr[3 * n + j], indptr[3 * n + j + 1]):
                at = indices[k]
                x, y, z = x + data[k] * u[at, 0], y + data[k] * u[at, 1], z + data[k] * u[at, 2]
            g[0, j], g[1, j], g[2, j] = x, y, z
            g[j, j] += 1.0
        ratio = (
            g[0, 0] * (g[1, 1] * g[2, 2] - g[1, 2] * g[2, 1])
            + g[0, 1] * (g[1, 2] * g[2, 0] - g[1, 0] * g[2, 2])
            + g[0, 2] * (g[1, 0] * g[2, 1] - g[1, 1] * g[2, 0])
        )
        size = 0.0
        for i in range(3):
            for j in range(3):
                size += g[i, j] * g[i, j]
        if ratio > 1e-3 * size**1.5:
            g /= ratio ** (1 / 3)
        else:
            g[:] = 0.0
            for i in range(3):
                g[i, i] = 1.0
