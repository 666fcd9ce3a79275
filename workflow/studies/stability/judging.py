"""Independent judges of one cell of the stability sweep: none takes a result's own word for it.

Forces are added by this file's own assembly, in numpy, from edges and Piola-Kirchhoff stresses; the patches of
elements are read as data, after a check that they are patches. Whether a sliding node is where its bone is, is asked of
the bone's triangles: the solver knows a field of distances alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from pinnochio.mechanics.boundary.sliding import SlidingSurfaces
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import Elements
from pinnochio.mechanics.settings import FemSettings, SolverSettings
from pinnochio.mechanics.solvers.inversion_repair import Repair
from pinnochio.mechanics.solvers.newton import SolveResult
from pinnochio.mechanics.solvers.newton_corrections import EQUILIBRIUM, Correction
from pinnochio.metrics.validity import OFF_BONE, off_bone
from pinnochio.model.predictions import Prediction
from pinnochio.patients.certificate import NOT_USABLE, measures, plain, verdict
from pinnochio.patients.result import Solution
from studies.stability.problems import Problem
from studies.stability.table import CLEAN, CONVERGED, WRONG

# What is asked of a field. Prescribed nodes: share of the mesh's extent. Sliding nodes and fields that must agree: mm;
# two equilibria differ by tenths of a millimetre. Elastic: forces on free unknowns over those on the others; of a map
# in single precision the rounding of its fields alone leaves MAP, and puts nodes that far from where they belong.
PRESCRIBED, SLIDING, AGREEMENT, ELASTIC, MAP, ROUNDED = 1e-9, 1e-5, 1e-3, 1e-8, 1e-2, 1e-5
HONEST = 0.01  # relative: of a figure that a method reports of itself against the judge's
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class Verdict:
    """outcome: one of OUTCOMES, and why; least J of the state; residual: what the judge measured, relative.

    marked: a wrong field that the certificate of `predict` calls not usable.
    """

    outcome: str
    reason: str
    min_jacobian: float = np.nan
    residual: float = np.nan
    marked: bool = False


class Balance:
    """Forces of a mesh, points (n, 3), cells (m, 4); patches (m,): of each element, without them the element itself."""

    def __init__(self, points, cells, material: Material, patches=None):
        self.points, self.cells, self.material = np.asarray(points, float), np.asarray(cells, int), material
        corners = self.points[self.cells]
        rest = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)  # edges in columns
        self.volumes, self.inverse = np.linalg.det(rest) / 6, np.linalg.inv(rest)
        self.patches = np.arange(len(cells)) if patches is None else np.asarray(patches)
        self.size = np.bincount(self.patches, self.volumes)
        self.lam = np.bincount(self.patches, self.volumes * material.lam) / self.size
        pairs = np.sort(self.cells[:, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]].reshape(-1, 2), axis=1)
        one, two = np.unique(pairs, axis=0).T
        self.edge = float(np.linalg.norm(self.points[one] - self.points[two], axis=1).mean())
        self.modulus = float(np.average(material.mu, weights=self.volumes))

    @classmethod
    def of(cls, problem: Problem, element: str) -> "Balance":
        """The forces of a problem's element."""
        law, patches = problem.material, None
        if element == "patch":
            patches = Elements.build(problem.points, problem.cells, law, element).patch
        return cls(problem.points, problem.cells, law, patches)

    def gradients(self, displacement) -> np.ndarray:
        """Displacement gradient (m, 3, 3) of the elements."""
        corners = np.asarray(displacement, float)[self.cells]
        return (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1) @ self.inverse

    def ratios(self, displacement) -> np.ndarray:
        """det F (m,) of the elements."""
        return np.linalg.det(np.eye(3) + self.gradients(displacement))

    def force(self, displacement) -> np.ndarray:
        """Internal force (n, 3) of the whole law."""
        f = np.eye(3) + self.gradients(displacement)
        cofactor = np.stack([np.cross(f[:, (i + 1) % 3], f[:, (i + 2) % 3]) for i in range(3)], axis=1)
        ratio = (f[:, 0] * cofactor[:, 0]).sum(axis=1)
        averaged = np.bincount(self.patches, self.volumes * ratio) / self.size
        log, slope = self._log(averaged)
        pressure = (self.lam * log * slope)[self.patches] - self.material.mu * self._log(ratio)[1]
        excess = (f**2).sum(axis=(1, 2)) - 3
        shear = self.material.mu + 2 * self.material.stiffening * excess
        return self._added(shear[:, None, None] * f + pressure[:, None, None] * cofactor)

    def linear(self, displacement) -> np.ndarray:
        """Force (n, 3) of linear elasticity at rest."""
        gradient = self.gradients(displacement)
        trace = np.trace(gradient, axis1=1, axis2=2)
        averaged = np.bincount(self.patches, self.volumes * trace) / self.size
        pressure = (self.lam * averaged)[self.patches] + 4 * self.material.stiffening * trace
        stress = self.material.mu[:, None, None] * (gradient + gradient.transpose(0, 2, 1))
        return self._added(stress + pressure[:, None, None] * np.eye(3))

    def residual(self, force, held) -> float:
        """Force (n, 3) on free nodes over that on held ones (p,), or at least over the one at a strain of 1e-4."""
        free = np.setdiff1d(np.arange(len(force)), held)
        least = 1e-4 * self.modulus * self.edge**2 * np.sqrt(3 * len(held))
        return float(np.linalg.norm(force[free]) / max(np.linalg.norm(force[held]), least))

    def _added(self, stress) -> np.ndarray:
        pulls = self.volumes[:, None, None] * stress @ self.inverse.transpose(0, 2, 1)  # of corners 1 to 3, in columns
        pulls = np.concatenate([-pulls.sum(axis=2, keepdims=True), pulls], axis=2).transpose(0, 2, 1)
        flat, count = self.cells.ravel(), len(self.points)
        return np.stack([np.bincount(flat, pulls[:, :, axis].ravel(), count) for axis in range(3)], axis=1)

    def _log(self, ratio) -> tuple[np.ndarray, np.ndarray]:
        """ln J and its slope, below the extension of the law by the parabola that touches it there."""
        least = self.material.extension
        there = np.maximum(ratio, least)
        short = (there - ratio) / least
        return np.log(there) - short - short**2 / 2, (1 + short) / there

    def no_patches(self) -> list[str]:
        """A complaint if there are patches that are none: of one Lame parameter each, joined by faces, of four elements
        or more but where fewer hang together, of 32 at most."""
        if len(self.size) == len(self.cells):
            return []
        lam = self.material.lam
        mixed = np.abs(lam - self.lam[self.patches]).max() > 1e-9 * lam.max()
        faces = np.sort(self.cells[:, [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]].reshape(-1, 3), axis=1)
        shared, number = np.unique(faces, axis=0, return_inverse=True)
        order = np.argsort(number.ravel(), kind="stable")
        ids = number.ravel()[order]
        at = np.flatnonzero(ids[1:] == ids[:-1])
        one, two = order[at] // 4, order[at + 1] // 4
        count = len(self.cells)

        def pieces(same) -> np.ndarray:
            graph = sparse.coo_matrix((np.ones(same.sum()), (one[same], two[same])), shape=(count, count))
            return connected_components(graph, directed=False)[1]

        torn = pieces(self.patches[one] == self.patches[two]).max() + 1 != len(self.size)
        sizes = np.bincount(self.patches)
        whole = pieces(lam[one] == lam[two])
        small = (sizes[self.patches] < 4) & (np.bincount(whole)[whole] >= 4)
        # A piece that is cut off by patches around it may stay small.
        odd = sizes.max() > 32 or small.mean() > 0.05
        wrong = {"of several tissues": mixed, "in pieces": torn, "too small or too large": odd}
        return [f"patches are {what}" for what, differing in wrong.items() if differing]


def judged(
    residual: float, limit: float, least: float, complaints: list[str], note: str = "", marks: Sequence[str] = ()
) -> Verdict:
    """Converged if the residual is below its limit and there is no complaint; else wrong, with all of them.

    marks: further complaints, which keep the field from a user of `predict`.
    """
    if not residual <= limit:
        complaints = [f"residual {residual:.1e}, at most {limit:.0e} allowed", *complaints]
    if complaints or marks:
        return Verdict(WRONG, "; ".join([*complaints, *marks]), least, residual, marked=not complaints)
    return Verdict(CONVERGED, note or "confirmed", least, residual)


def judge_solution(
    problem: Problem,
    element: str,
    result: SolveResult,
    seconds: float,
    options: SolverSettings,
    known: np.ndarray | None = None,
    unique: bool = True,
) -> Verdict:
    """Verdict on what the solver claims in `seconds`; known (n, 3): the field in mm that another way has led to.

    unique: there is but one equilibrium, so that the field must be the known one; else the reason tells of another.
    """
    displacement = result.displacement
    if not np.isfinite(displacement).all():
        return Verdict(WRONG, "the displacement is not finite")
    balance = Balance.of(problem, element)
    least = float(balance.ratios(displacement).min())
    force = balance.force(displacement)
    residual, complaints = conditions(problem, balance, displacement, force)
    if not result.converged:
        # A tenth more: the limit is looked at between two steps.
        if seconds > 1.1 * options.time_limit + 1:
            return Verdict(WRONG, f"stopped after {seconds:.0f} s only", least, residual)
        if not result.reason:
            return Verdict(WRONG, "stopped without a reason", least, residual)
        return Verdict(CLEAN, f"{result.reason}, at {100 * result.fraction:.0f} % of the load", least, residual)
    if not least > 0:
        complaints.append(f"least J is {least:.2g}")
    complaints += balance.no_patches()
    other = differs(problem, displacement, known)
    complaints += other if unique else []
    note, marks = f"confirmed; another equilibrium, {other[0]}" if other else "", []
    away = hanging(problem, displacement)
    if away > OFF_BONE:
        marks.append(f"sliding tissue has left its bone by {away:.1f} mm")
    # Three times the tolerance: of the points that make a sliding surface the solvers leave out others than each other
    # (weights below 1e-5 and 1e-10), which turns its normals by 2e-6, and forces with them [X].
    return judged(residual, 3 * options.tolerance, least, complaints, note, marks)


def judge_elastic(
    problem: Problem, element: str, displacement: np.ndarray, known: np.ndarray | None = None, rounded: bool = False
) -> Verdict:
    """Verdict on a linear elastic field (n, 3); rounded: it is a map in single precision."""
    if not np.isfinite(displacement).all():
        return Verdict(WRONG, "the displacement is not finite")
    balance = Balance.of(problem, element)
    residual, complaints = conditions(
        problem, balance, displacement, balance.linear(displacement), linear=True, rounded=rounded
    )
    ratio = balance.ratios(displacement)
    inverted = int((ratio <= 0).sum())
    complaints += differs(problem, displacement, known, 0.01 if rounded else AGREEMENT)
    note = f"confirmed; linear, hence {inverted} elements inside out" if inverted else ""
    return judged(residual, MAP if rounded else ELASTIC, float(ratio.min()), complaints, note)


def judge_repair(problem: Problem, raw: np.ndarray, field: np.ndarray, repair: Repair) -> Verdict:
    """Verdict on a field (n, 3) that the inversion repair made of a raw one, and on what it says that it did."""
    if not np.isfinite(field).all():
        return Verdict(WRONG, "the displacement is not finite")
    balance = Balance(problem.points, problem.cells, problem.material)
    before, after, complaints = balance.ratios(raw), balance.ratios(field), []
    least = float(after.min())
    if not least > 0:
        complaints.append(f"{(after <= 0).sum()} elements are left inside out")
    way = np.linalg.norm(field - raw, axis=1)
    claims = {
        "least J before": (repair.raw_least, float(before.min())),
        "inverted before": (repair.raw_inverted, int((before <= 0).sum())),
        "least J after": (repair.least, least),
        "largest way": (repair.change, float(way.max())),
    }
    complaints += [f"{name} is said to be {said:.3g}, is {is_:.3g}" for name, (said, is_) in claims.items()
                   if not abs(said - is_) <= HONEST * max(abs(is_), 1e-6)]  # fmt: skip
    if repair.damping == 1 and not repair.interface:
        fixed = np.setdiff1d(np.arange(len(field)), problem.free)
        complaints += ["interface nodes have moved unsaid"] if way[fixed].max(initial=0.0) > 0 else []
    if complaints:
        return Verdict(WRONG, "; ".join(complaints), least)
    if repair.damping < 1:
        return Verdict(CLEAN, f"field scaled to {100 * repair.damping:.2g} %", least)
    return Verdict(CONVERGED, f"confirmed; {repair.elements} of {len(before)} elements solved again", least)


def judge_correction(
    problem: Problem, element: str, made: list[Correction], nodes, belong, repair: Repair, tolerance: float
) -> Verdict:
    """Verdict on the last of some Newton corrections; nodes (p,) belong where they are put, (p, 3)."""
    last = made[-1]
    if not np.isfinite(last.displacement).all():
        return Verdict(WRONG, "the displacement is not finite")
    balance = Balance.of(problem, element)
    force, least = balance.force(last.displacement), float(balance.ratios(last.displacement).min())
    residual = balance.residual(force, nodes)
    complaints = [] if least > 0 else [f"least J is {least:.2g}"]
    claims = {"residual": (last.residual, residual), "least J": (last.least, least)}
    complaints += [f"{name} is said to be {said:.3g}, is {is_:.3g}" for name, (said, is_) in claims.items()
                   if not abs(said - is_) <= HONEST * abs(is_) + 1e-9]  # fmt: skip
    if complaints:
        return Verdict(WRONG, "; ".join(complaints), least, residual)
    gap = float(np.linalg.norm(last.displacement[nodes] - belong, axis=1).max(initial=0.0))
    scaled = f", field scaled to {100 * repair.damping:.2g} %" if repair.damping < 1 else ""
    if residual <= tolerance and not scaled:
        moved = f", interface mended by {gap:.1f} mm" if gap > AGREEMENT else ""
        return Verdict(CONVERGED, f"confirmed after {len(made) - 1} corrections{moved}", least, residual)
    return Verdict(CLEAN, f"residual {residual:.1e} after {len(made) - 1} corrections{scaled}", least, residual)


def judge_network(problem: Problem, element: str, made: Prediction, fem: FemSettings) -> Verdict:
    """Verdict on a network's prediction of a patient: no element is inside out, and no tissue that is attached to bone
    or slides along it is more than OFF_BONE away. A scaled field, which the certificate never calls usable, and a
    residual above EQUILIBRIUM under the load that the prediction declares, which it states, fail cleanly."""
    field = made.displacement
    if not np.isfinite(field).all():
        return Verdict(WRONG, "the displacement is not finite")
    balance = Balance.of(problem, element)
    force, least = balance.force(field), float(balance.ratios(field).min())
    force = force if made.forces is None else force - made.forces
    residual = balance.residual(force, np.setdiff1d(np.arange(len(field)), problem.free))
    after = f"after {made.iterations} corrections"
    if made.damping < 1:
        return Verdict(CLEAN, f"field scaled to {100 * made.damping:.2g} %", least, residual)
    complaints = [] if least > 0 else [f"least J is {least:.2g}"]
    prescribed = np.asarray(problem.boundary.prescribed_nodes, int)
    away = np.linalg.norm(field[prescribed] - problem.boundary.displacement(1.0), axis=1).max(initial=0.0)
    complaints += [f"attached tissue is {away:.1f} mm from its bone"] if away > OFF_BONE else []
    off = hanging(problem, field)
    complaints += [f"sliding tissue has left its bone by {off:.1f} mm"] if off > OFF_BONE else []
    if complaints:
        solution = Solution(repaired=int(np.nan_to_num(made.repaired)))
        measured = plain(measures(problem.patient, problem.plan, field, fem, made.forces))
        grade = verdict({"solution": vars(solution), "measures": measured, "models": None}).grade
        return Verdict(WRONG, "; ".join(complaints), least, residual, marked=grade == NOT_USABLE)
    if not residual <= EQUILIBRIUM:
        return Verdict(CLEAN, f"residual {residual:.1e} {after}", least, residual)
    return Verdict(CONVERGED, f"confirmed {after}", least, residual)


def conditions(
    problem: Problem, balance: Balance, displacement, force, linear: bool = False, rounded: bool = False
) -> tuple[float, list[str]]:
    """Forces (n, 3) on the free unknowns over those on the others, and which boundary conditions are not met.

    linear: of the linearised problem, whose sliding nodes keep to the normals at rest; rounded: of a field in single
    precision.
    """
    prescribed = np.asarray(problem.boundary.prescribed_nodes, int)
    extent = np.ptp(problem.points, axis=0).max()
    complaints = []
    error = np.abs(displacement[prescribed] - problem.boundary.displacement(1.0)).max(initial=0.0)
    if error > (ROUNDED if rounded else PRESCRIBED) * extent:
        complaints.append(f"prescribed nodes are {error:.1e} off")
    sliding = SlidingSurfaces(problem.points, problem.boundary.sliding)
    normals = slopes(sliding, np.zeros_like(displacement) if linear else displacement, 0.0 if linear else 1.0)
    if linear:
        carried = [item.motion(1.0).displacement(sliding.points[item.nodes]) for item in sliding.sets]
        left = displacement[sliding.nodes] - np.concatenate([np.zeros((0, 3)), *carried])
        opened = np.einsum("si,si->s", left, normals)
    else:
        opened = sliding.at(1.0).violation(displacement)
    away = np.abs(opened).max(initial=0.0)
    if away * problem.millimetres > (ROUNDED * extent if rounded else SLIDING):
        complaints.append(f"sliding nodes are {away:.1e} off their surface")
    reaction = np.zeros_like(force)
    reaction[prescribed] = force[prescribed]
    reaction[sliding.nodes] = np.einsum("si,si->s", force[sliding.nodes], normals)[:, None] * normals
    # The reaction at a strain of 1e-4: the measure where the load asks for no force.
    count = 3 * len(prescribed) + len(sliding.nodes)
    least = 1e-4 * balance.modulus * balance.edge**2 * np.sqrt(count)
    return float(np.linalg.norm(force - reaction) / max(np.linalg.norm(reaction), least)), complaints


def hanging(problem: Problem, displacement) -> float:
    """How far a sliding node has left the triangles of its bone, mm; 0 of a problem without a patient."""
    if problem.patient is None or not problem.boundary.sliding:
        return 0.0
    return float(off_bone(problem.patient, problem.plan, displacement).max(initial=0.0))


def slopes(sliding: SlidingSurfaces, displacement, fraction: float) -> np.ndarray:
    """Unit normals (s, 3) of the level sets that the sliding nodes keep to, by differences of their distances."""
    # The distance jumps by some 1e-7 mm where another point of the bone is the last that counts: the slope across such
    # a place is far off, the median of five slopes side by side is not.
    held, step, columns = sliding.at(fraction), 1e-6, []
    for axis in np.eye(3):
        shift = np.zeros_like(displacement)
        shift[sliding.nodes] = step * axis
        distance = [held.violation(displacement + place * shift) for place in np.arange(6) - 2.5]
        columns.append(np.median(np.diff(distance, axis=0), axis=0) / step)
    gradient = np.stack(columns, axis=1)
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def differs(problem: Problem, displacement, known, limit: float = AGREEMENT) -> list[str]:
    """A complaint if a field (n, 3) is not the known one (n, 3) in mm."""
    if known is None:
        return []
    error = np.abs(displacement * problem.millimetres - known).max()
    return [f"{error:.1e} mm from the known field"] if not error <= limit else []
