"""Independent judges of one cell of the stability sweep: none takes a result's own word for it.

The judge of a displacement is the torch residual in float64, that of the torch loss the compiled kernels in float64.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from pinnochio.experiments.stability_problems import Problem
from pinnochio.mechanics.elements import Elements
from pinnochio.mechanics.residual import Operator
from pinnochio.mechanics.sliding import SlidingContact
from pinnochio.mechanics.solver import SolveResult, SolverOptions
from pinnochio.tables.stability import CLEAN, CONVERGED, WRONG

# What is asked of a field. Prescribed nodes: share of the mesh's extent. Sliding nodes and fields that must agree: mm;
# two equilibria differ by tenths of a millimetre. Elastic: forces on free unknowns over those on the others.
PRESCRIBED, SLIDING, AGREEMENT, ELASTIC = 1e-9, 1e-6, 1e-3, 1e-8
# What is asked of the loss, whose root is the force on a free node in units of mu h^2. In float64: of its value against
# the compiled kernels, of its gradient along random directions against differences of these. In float32: of both
# against float64; the largest error at any setting was 5e-6 [X].
VALUE, DIFFERENCE, SINGLE = 1e-10, 1e-6, 1e-4
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class Verdict:
    """outcome: one of OUTCOMES, and why; least J of the state; residual: what the judge measured, relative."""

    outcome: str
    reason: str
    min_jacobian: float = np.nan
    residual: float = np.nan


def judged(residual: float, limit: float, least: float, complaints: list[str], note: str = "") -> Verdict:
    """Converged if the residual is below its limit and there is no complaint; else wrong, with all of them."""
    if not residual <= limit:
        complaints = [f"residual {residual:.1e}, at most {limit:.0e} allowed", *complaints]
    if complaints:
        return Verdict(WRONG, "; ".join(complaints), least, residual)
    return Verdict(CONVERGED, note or "confirmed", least, residual)


def judge_solution(
    problem: Problem,
    element: str,
    result: SolveResult,
    seconds: float,
    options: SolverOptions,
    known: np.ndarray | None = None,
    unique: bool = True,
) -> Verdict:
    """Verdict on what the solver claims in `seconds`; known (n, 3): the field in mm that another way has led to.

    unique: there is but one equilibrium, so that the field must be the known one; else the reason tells of another.
    """
    if not np.isfinite(result.displacement).all():
        return Verdict(WRONG, "the displacement is not finite")
    operator = Operator.build(problem.points, problem.cells, problem.material, element)
    field = torch.as_tensor(result.displacement)
    least = float(operator.jacobians(field).min())
    force = operator.force(field).numpy()
    residual, complaints = conditions(problem, operator, result.displacement, force)
    if not result.converged:
        # A tenth more: the limit is looked at between two steps.
        if seconds > 1.1 * options.time_limit + 1:
            return Verdict(WRONG, f"stopped after {seconds:.0f} s only", least, residual)
        if not result.reason:
            return Verdict(WRONG, "stopped without a reason", least, residual)
        return Verdict(CLEAN, result.reason, least, residual)
    if not least > 0:
        complaints.append(f"least J is {least:.2g}")
    other = differs(problem, result.displacement, known)
    complaints += other if unique else []
    note = f"confirmed; another equilibrium, {other[0]}" if other else ""
    # Twice the tolerance: the judge takes the normals of sliding surfaces by differences.
    return judged(residual, 2 * options.tolerance, least, complaints, note)


def judge_elastic(problem: Problem, element: str, displacement: np.ndarray, known: np.ndarray | None = None) -> Verdict:
    """Verdict on a linear elastic field (n, 3): the stiffness at rest, differentiated from the residual, times it."""
    if not np.isfinite(displacement).all():
        return Verdict(WRONG, "the displacement is not finite")
    operator = Operator.build(problem.points, problem.cells, problem.material, element)
    field, rest = torch.as_tensor(displacement), torch.zeros(displacement.shape, dtype=torch.float64).requires_grad_()
    # The stiffness is symmetric, so that the gradient of f . u at rest is K u.
    (force,) = torch.autograd.grad((operator.force(rest) * field).sum(), rest)
    residual, complaints = conditions(problem, operator, displacement, force.numpy(), linear=True)
    ratio = operator.jacobians(field)
    inverted = int((ratio <= 0).sum())
    complaints += differs(problem, displacement, known)
    note = f"confirmed; linear, hence {inverted} elements inside out" if inverted else ""
    return judged(residual, ELASTIC, float(ratio.min()), complaints, note)


def conditions(problem: Problem, operator, displacement, force, linear: bool = False) -> tuple[float, list[str]]:
    """Forces (n, 3) on the free unknowns over those on the others, and which boundary conditions are not met.

    linear: of the linearised problem, whose sliding nodes keep to the normals at rest.
    """
    prescribed = np.asarray(problem.boundary.prescribed_nodes, int)
    extent = np.ptp(problem.points, axis=0).max()
    complaints = []
    error = np.abs(displacement[prescribed] - problem.boundary.displacement(1.0)).max(initial=0.0)
    if error > PRESCRIBED * extent:
        complaints.append(f"prescribed nodes are {error:.1e} off")
    sliding = SlidingContact(problem.points, problem.boundary.sliding)
    normals = slopes(sliding, np.zeros_like(displacement) if linear else displacement, 0.0 if linear else 1.0)
    if linear:
        carried = [item.motion(1.0).displacement(sliding.points[item.nodes]) for item in sliding.sets]
        left = displacement[sliding.nodes] - np.concatenate([np.zeros((0, 3)), *carried])
        opened = np.einsum("si,si->s", left, normals)
    else:
        opened = sliding.violation(displacement, 1.0)
    away = np.abs(opened).max(initial=0.0)
    if away * problem.millimetres > SLIDING:
        complaints.append(f"sliding nodes are {away:.1e} off their surface")
    reaction = np.zeros_like(force)
    reaction[prescribed] = force[prescribed]
    reaction[sliding.nodes] = np.einsum("si,si->s", force[sliding.nodes], normals)[:, None] * normals
    # The reaction at a strain of 1e-4: the measure where the load asks for no force.
    count = 3 * len(prescribed) + len(sliding.nodes)
    least = 1e-4 * operator.mu_ref * operator.h_ref**2 * np.sqrt(count)
    return float(np.linalg.norm(force - reaction) / max(np.linalg.norm(reaction), least)), complaints


def slopes(sliding: SlidingContact, displacement, fraction: float) -> np.ndarray:
    """Unit normals (s, 3) of the level sets that the sliding nodes keep to, by differences of their distances."""
    # The distance jumps by some 1e-7 mm where another point of the bone is the last that counts: the slope across such
    # a place is far off, the median of five slopes side by side is not.
    step, columns = 1e-6, []
    for axis in np.eye(3):
        shift = np.zeros_like(displacement)
        shift[sliding.nodes] = step * axis
        distance = [sliding.violation(displacement + place * shift, fraction) for place in np.arange(6) - 2.5]
        columns.append(np.median(np.diff(distance, axis=0), axis=0) / step)
    gradient = np.stack(columns, axis=1)
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def differs(problem: Problem, displacement, known) -> list[str]:
    """A complaint if a field (n, 3) is not the known one (n, 3) in mm."""
    if known is None:
        return []
    error = np.abs(displacement * problem.millimetres - known).max()
    return [f"{error:.1e} mm from the known field"] if not error <= AGREEMENT else []


def slope_of(
    problem: Problem, element: str, precision: str, state: np.ndarray, extension: float, loss: Callable
) -> tuple[float, np.ndarray]:
    """The physics loss and its gradient (n, 3) at a state (n, 3), in a precision.

    loss(operator, free) gives the loss as a function of the displacement; extension: volume ratio below which its
    energy is extended.
    """
    law, dtype = replace(problem.material, extension=extension), getattr(torch, precision)
    operator = Operator.build(problem.points, problem.cells, law, element, dtype)
    field = torch.as_tensor(state, dtype=dtype).requires_grad_()
    value = loss(operator, torch.as_tensor(problem.free))(field)
    (gradient,) = torch.autograd.grad(value, field)
    return float(value.detach()), gradient.numpy().astype(float)


def judge_loss(
    problem: Problem,
    element: str,
    precision: str,
    state: np.ndarray,
    slope: tuple[float, np.ndarray],
    exact: tuple[float, np.ndarray],
    extension: float,
    rng: np.random.Generator,
) -> Verdict:
    """Verdict on the value and gradient `slope` at a state (n, 3), which float32 represents; exact: those in float64.

    residual: the largest of the relative errors.
    """
    kernels = Elements.build(problem.points, problem.cells, replace(problem.material, extension=extension), element)
    scale = kernels.modulus * kernels.edge**2

    def compiled(displacement) -> float:
        return float(((kernels.evaluate(displacement)[1][problem.free] / scale) ** 2).sum(axis=1).mean())

    least, (value, gradient) = kernels.evaluate(state)[2], slope
    if not (np.isfinite(value) and np.isfinite(gradient).all()):
        return Verdict(WRONG, "the loss or its gradient is not finite", least)
    if precision == "float64":
        truth, size, gap = compiled(state), np.linalg.norm(gradient), 0.0
        errors = {"value": (abs(value - truth) / max(truth, TINY), VALUE)}
        for _ in range(3):
            way = rng.normal(size=state.shape)
            # Where an element passes the extension of its energy on the way, the gradient has a kink, and the longer
            # step is off.
            differences = [difference(compiled, state, way, step * kernels.edge) for step in (1e-6, 1e-7)]
            gap = max(gap, min(abs((gradient * way).sum() - value) for value in differences))
        errors["gradient"] = (gap / max(size, TINY), DIFFERENCE)
    else:
        force, truth = np.sqrt(value), np.sqrt(exact[0])
        gap, size = np.linalg.norm(gradient - exact[1]), np.linalg.norm(exact[1])
        errors = {"value": (abs(force - truth) / max(truth, 1.0), SINGLE), "gradient": (gap / max(size, TINY), SINGLE)}
    complaints = [
        f"{name} off by {error:.1e}, at most {limit:.0e} allowed"
        for name, (error, limit) in errors.items()
        if not error <= limit
    ]
    return judged(max(error for error, _ in errors.values()), np.inf, least, complaints)


def difference(function: Callable, place: np.ndarray, way: np.ndarray, step: float) -> float:
    """Derivative of a function along `way` by central differences of fourth order."""
    near, far = (function(place + k * step * way) - function(place - k * step * way) for k in (1, 2))
    return (8 * near - far) / (12 * step)
