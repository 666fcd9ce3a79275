"""Many plans of one patient: quasi-Newton steps on the factors of the stiffness at rest, which are kept.

Mesh, material and constrained nodes are the patient's, motions alone the plan's. A plan begins with its linear field
and goes on by L-BFGS (Nocedal 1980), one force and one solution by the kept factors an iteration. Two things make that
few iterations [X]:

* the factors are warped: loads are pulled back, and motions pushed forward, by the mean deformation gradient G of each
  node, scaled to determinant 1. A field that keeps volume at rest keeps it when pushed forward so (Piola), so that the
  stiff and the soft fields of nearly incompressible tissue stay apart. Of a sliding node, G takes the tangents of the
  bone's surface at rest to those where the node is now.
* patches with a hard element (squeezed or stretched far), and those that touch sliding nodes, are brought to
  equilibrium by Newton's method before each step: there the stiffness has little to do with that at rest.

What does not converge so is solved by Newton's method from rest, as `solver.solve` does; so are contact and loads.
"""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pinnochio.compiled import compiled
from pinnochio.mechanics.constraints import Constraints
from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.elements import ElementArrays, deformation
from pinnochio.mechanics.local_equilibrium import LocalEquilibrium
from pinnochio.mechanics.materials import Material
from pinnochio.mechanics.point_surface import CompiledSurface
from pinnochio.mechanics.sliding import BoundaryConditions
from pinnochio.mechanics.solver import SolveResult, SolverOptions, solve

MEMORY = 5  # pairs of steps and changes of the force that are kept
# An element is hard below this volume ratio, or above this I1 = tr F'F, 3 at rest.
HARD_RATIO, HARD_STRETCH = 0.5, 8.0
LOOSE = 0.1  # force left in the hard patches, over that outside, before a step
# Least cosine between the surface's normals where the linear field puts a sliding node and where it ends. Beyond, it
# has gone round the rim of its bone, and which equilibrium it found depends on the way: Newton's method decides [X].
RIM = 0.4
ITERATIONS = 60  # after so many a plan goes to Newton's method


class Point(NamedTuple):
    """A displacement (n, 3) mm at full load, its energy, least J, local axes (s, 3, 3) of the sliding nodes, force
    (n, 3) mN in local axes, and the norm of the force on the constrained unknowns."""

    u: np.ndarray
    energy: float
    least: float
    axes: np.ndarray
    force: np.ndarray
    reaction: float


@dataclass
class Path:
    """How one plan was solved; part: its hard patches."""

    constraints: Constraints
    part: LocalEquilibrium | None = None
    point: Point | None = None
    residual: float = np.inf
    iterations: int = 0
    local_iterations: int = 0
    reason: str = ""
    history: list[dict] = field(default_factory=list)


class RepeatedSolver:
    """The factors of one mesh with one set of constrained nodes, for any number of motions.

    points (n, 3) mm, cells (m, 4). The first boundary tells the nodes and the bones that they slide on.
    """

    def __init__(self, points, cells, material: Material, boundary: BoundaryConditions, options: SolverOptions):
        self._points, self._cells, self._material, self._options = np.asarray(points, float), cells, material, options
        self._rest = ElasticSolver(
            points, cells, material, boundary, options.volumetric, options.linear_solver, True, CompiledSurface
        )
        self._elements, self._constraints = self._rest.elements, self._rest.constraints
        elements, nodes = self._elements, self._constraints.sliding.nodes
        used = np.zeros(len(self._points), bool)
        used[elements.cells] = True
        self._free = used[:, None] & ~self._constraints.constrained
        self._shell = np.zeros(len(elements.patch_volumes), bool)
        slides = np.zeros(len(self._points), bool)
        slides[nodes] = True
        self._shell[elements.patch[slides[elements.cells].any(axis=1)]] = True

    def solve(self, boundaries: Sequence[BoundaryConditions]) -> list[SolveResult]:
        """The solution of each boundary condition, which differs from the first one in its motion alone.

        All advance together, so that their loads meet the factors together; a plan that fails does not stop others.
        """
        began = time.perf_counter()
        quick = [not (item.contact or item.loads) and self._options.barrier for item in boundaries]
        paths = [Path(self._constraints.under(item)) for item, fast in zip(boundaries, quick, strict=True) if fast]
        self._advance(paths)
        share = (time.perf_counter() - began) / max(len(paths), 1)
        done, results = iter(paths), []
        for boundary, fast in zip(boundaries, quick, strict=True):
            path = next(done) if fast else None
            if path is not None and not path.reason:
                results.append(self._result(path, share))
                continue
            result = solve(self._points, self._cells, self._material, boundary, self._options)
            results.append(replace(result, seconds=result.seconds + (share if fast else 0)))
        return results

    def close(self) -> None:
        """Release the factors."""
        self._rest.close()

    def _advance(self, paths: Sequence[Path]) -> None:
        if not paths:
            return
        starts = self._rest.spread(np.stack([path.constraints.motions() for path in paths]))
        walks = [self._walk(path, start) for path, start in zip(paths, starts, strict=True)]
        loads = {number: self._sent(walk, paths[number], None) for number, walk in enumerate(walks)}
        while loads := {number: load for number, load in loads.items() if load is not None}:
            answers = self._rest.respond(np.stack(list(loads.values())))
            loads = {
                number: self._sent(walks[number], paths[number], answer)
                for number, answer in zip(loads, answers.reshape(len(loads), -1), strict=True)
            }

    @staticmethod
    def _sent(walk: Generator, path: Path, answer: np.ndarray | None) -> np.ndarray | None:
        """The next load of a plan, None at its end; what goes wrong in it is its own reason and stops no other."""
        try:
            return walk.send(answer)
        except StopIteration:
            return None
        except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
            path.reason = f"{type(error).__name__}: {error}"
            return None

    def _walk(self, path: Path, start) -> Generator[np.ndarray, np.ndarray, None]:
        """One plan from its linear field (n, 3) to equilibrium; gives loads (f,) and is sent what they cause."""
        pairs: list[tuple] = []
        start = path.constraints.met(start, 1.0)
        normals = self._axes(path.constraints, start)[:, 0]
        point = self._settled(path, start)
        try:
            while True:
                gradient = point.force[self._free]
                path.point, path.residual = point, self._residual(point)
                path.history.append({"residual": path.residual, "energy": point.energy, "min_jacobian": point.least})
                if path.residual <= self._options.tolerance:
                    if (normals * point.axes[:, 0]).sum(axis=1).min(initial=1.0) < RIM:
                        path.reason = "a node slid round the rim of its bone"
                    return
                if path.iterations == ITERATIONS:
                    path.reason = f"{ITERATIONS} iterations left a residual of {path.residual:.1e}"
                    return
                direction = yield from self._direction(point, gradient, pairs)
                new = self._searched(path, point, direction, gradient)
                path.iterations += 1
                if new is None:
                    path.reason = f"the line search stagnated at a residual of {path.residual:.1e}"
                    return
                step = self._turned(new.u - point.u, new.axes)[self._free]
                change = new.force[self._free] - gradient
                if step @ change > 1e-12 * np.linalg.norm(step) * np.linalg.norm(change):
                    pairs = [*pairs, (step, change, 1 / (step @ change))][-MEMORY:]
                point = new
        finally:
            if path.part is not None:
                path.part.close()

    def _direction(self, point: Point, gradient, pairs) -> Generator[np.ndarray, np.ndarray, np.ndarray]:
        """Minus the product of the inverse Hessian that L-BFGS knows with the gradient (f,)."""
        q, shares = gradient.copy(), []
        for step, change, scale in reversed(pairs):
            shares.append(scale * (step @ q))
            q -= shares[-1] * change
        warp = self._warp(point)
        whole = np.zeros(self._free.shape)
        whole[self._free] = q
        whole[self._free] = yield np.einsum("nji,nj->ni", warp, whole)[self._free]
        q = np.einsum("nij,nj->ni", warp, whole)[self._free]
        for (step, change, scale), share in zip(pairs, reversed(shares), strict=True):
            q += (share - scale * (change @ q)) * step
        return -q

    def _warp(self, point: Point) -> np.ndarray:
        """Mean deformation gradient (n, 3, 3) at the nodes, of determinant 1, from axes at rest to those of now."""
        warp = np.zeros((len(self._points), 3, 3))
        _mean_gradients(point.u, self._elements.arrays, warp)
        nodes = self._constraints.sliding.nodes
        warp[nodes] = point.axes @ warp[nodes] @ self._rest.frames.transpose(0, 2, 1)
        warp[nodes, 0, :] = warp[nodes, :, 0] = 0
        return warp

    def _searched(self, path: Path, point: Point, direction, gradient) -> Point | None:
        """The state after a step along `direction` (f,) on which the energy falls, its hard patches in equilibrium.

        A step that turns elements inside out serves if these find their way out while the rest stays.
        """
        motion = np.zeros(self._free.shape)
        motion[self._free] = direction
        nodes, slope = self._constraints.sliding.nodes, direction @ gradient
        motion[nodes] = np.einsum("sij,si->sj", point.axes, motion[nodes])
        if not slope < 0:
            return None
        noise = 1e-14 * self._elements.modulus * self._elements.volumes.sum() + 1e-13 * abs(point.energy)
        allowed = 0.0 if point.least > 0 else -np.inf
        for halvings in range(20):
            step = 0.5**halvings
            new = self._settled(path, path.constraints.met(point.u + step * motion, 1.0))
            if new.energy <= point.energy + 1e-4 * step * slope + noise and new.least > allowed:
                return new
        return None

    def _settled(self, path: Path, u) -> Point:
        """The state at `u` (n, 3) with its hard patches in equilibrium."""
        point = self._point(path, u)
        hard = np.zeros(len(self._elements.patch_volumes), bool)
        _mark_hard(u, self._elements.arrays, HARD_RATIO, HARD_STRETCH, hard)
        if (
            path.part is None
            and (hard | self._shell).any()
            or path.part is not None
            and (hard & ~path.part.patches).any()
        ):
            nodes = np.zeros(len(self._points), bool)
            nodes[self._elements.cells[hard[self._elements.patch]]] = True
            wide = self._shell.copy()
            wide[self._elements.patch[nodes[self._elements.cells].any(axis=1)]] = True
            if path.part is not None:
                path.part.close()
            path.part = LocalEquilibrium(self._elements, path.constraints, wide, self._options.linear_solver)
        if path.part is None:
            return point
        outside = np.linalg.norm(point.force[self._free & ~path.part.inside])
        goal = max(LOOSE * outside, 0.3 * self._options.tolerance * self._least_reaction(point))
        settled, made = path.part.settled(u, path.constraints, goal, lambda u: self._axes(path.constraints, u))
        path.local_iterations += made
        return self._point(path, settled) if made else point

    def _point(self, path: Path, u) -> Point:
        energy, force, least = self._elements.evaluate(u)
        axes = self._axes(path.constraints, u)
        local = self._turned(force, axes)
        return Point(u, energy, least, axes, local, float(np.linalg.norm(local[path.constraints.constrained])))

    def _least_reaction(self, point: Point) -> float:
        elements = self._elements
        least = 1e-4 * elements.modulus * elements.edge**2 * np.sqrt(self._constraints.constrained.sum())
        return max(point.reaction, least, np.finfo(float).tiny)

    def _residual(self, point: Point) -> float:
        return float(np.linalg.norm(point.force[self._free]) / self._least_reaction(point))

    def _axes(self, constraints: Constraints, u) -> np.ndarray:
        """Local axes (s, 3, 3) of the sliding nodes: those at rest, turned by their bone and no further than the normal
        of its surface asks, so that they change no faster than the surface bends."""
        carried, done = np.empty_like(self._rest.frames), 0
        for item in constraints.sliding.sets:
            own = slice(done, done + len(item.nodes))
            carried[own] = self._rest.frames[own] @ item.motion(1.0).rotation.T
            done = own.stop
        here = constraints.sliding.frames(u, 1.0)
        one, other = carried[:, 0], here[:, 0]
        cosine = (one * other).sum(axis=1)
        axis = np.cross(one, other)
        # Rodrigues: v -> v + axis x v + axis x (axis x v) / (1 + cosine)
        turn = np.cross(axis[:, None], carried)
        turned = carried + turn + np.cross(axis[:, None], turn) / np.maximum(1 + cosine, 1e-6)[:, None, None]
        return np.where((cosine > -0.9)[:, None, None], turned, here)

    def _turned(self, vectors, axes) -> np.ndarray:
        return self._constraints.local(vectors, axes)

    def _result(self, path: Path, seconds: float) -> SolveResult:
        point = path.point
        violation = np.abs(path.constraints.sliding.violation(point.u, 1.0))
        return SolveResult(
            displacement=point.u,
            converged=True,
            reason="converged",
            history=[{"kind": "kept", "step": 1.0, "fraction": 1.0} | entry for entry in path.history],
            min_jacobian=point.least,
            fraction=1.0,
            residual=path.residual,
            violation=float(violation.max(initial=0.0)),
            penetration=0.0,
            gap=0.0,
            increments=1,
            iterations=path.iterations,
            factorizations=0,
            linear_iterations=path.iterations,
            seconds=seconds,
            kept=True,
        )


@compiled
def _mean_gradients(u, mesh: ElementArrays, mean):
    """Adds to mean (n, 3, 3) the deformation gradients of the elements by volume; scales them to determinant 1."""
    f, cof = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(mesh.cells)):
        deformation(u, mesh.cells[e], mesh.gradients[e], f, cof)
        for a in range(4):
            for i in range(3):
                for j in range(3):
                    mean[mesh.cells[e, a], i, j] += mesh.volumes[e] * f[i, j]
    for n in range(len(mean)):
        g = mean[n]
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


@compiled
def _mark_hard(u, mesh: ElementArrays, ratio, stretch, hard):
    """Marks the patches (p,) that hold an element with J below `ratio` or I1 above `stretch`."""
    f, cof = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(mesh.cells)):
        j, excess = deformation(u, mesh.cells[e], mesh.gradients[e], f, cof)
        if j < ratio or excess + 3 > stretch:
            hard[mesh.patch[e]] = True
