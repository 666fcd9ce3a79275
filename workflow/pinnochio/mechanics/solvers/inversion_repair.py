"""No prediction leaves with an inverted element: the smallest local repair of a displacement field."""

from dataclasses import dataclass, replace

import numpy as np

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.materials import EXTENSION, Material
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, jacobians
from pinnochio.mechanics.settings import SolverSettings
from pinnochio.mechanics.solvers.newton import TANGLED, solve

# Least J that needs no repair: below it ln J is extended, so that the strain energy is no longer the study's own law.
# Fields in equilibrium stay above it: the least of 80 finite-element predictions at 5,000 nodes is 0.08 [X].
FLOOR = EXTENSION
# What is tried in turn: rings of elements around the bad ones that are solved, and whether interface nodes of bad
# elements are freed. More rings before a free node: the interface is what the prediction stands on.
TRIES = ((1, False), (2, False), (2, True), (4, True), (8, True))
# A residual that is enough for J; the repaired part stands in a field that is no equilibrium itself.
# No time limit: the result must not depend on the machine.
OPTIONS = SolverSettings(
    volumetric="patch",
    increments=2,
    tolerance=1e-3,
    max_iterations=25,
    max_systems=1000,
    linear_solver="auto",
    restart=False,
)


@dataclass(frozen=True)
class Repair:
    """What the inversion repair measured and did: least J and inverted elements of the field before; least J after.

    elements: those that were solved again; nodes: those that have moved, interface: those of the interface among them;
    change: the largest way of one, mm; damping: factor on the whole field, 1 for none.
    """

    raw_least: float
    raw_inverted: int
    least: float
    elements: int = 0
    nodes: int = 0
    interface: int = 0
    change: float = 0.0
    damping: float = 1.0


def repair_inversions(
    points, cells, material: Material, displacement, interface, volumetric: str = VOLUMETRIC[0]
) -> tuple[np.ndarray, Repair]:
    """The displacement (n, 3) mm with every J above 0, and what was done to it: nothing where all are above FLOOR.

    points (n, 3) mm, cells (m, 4), interface (n,) bool: nodes that stay where they are if that can be. Elements below
    FLOOR are solved to equilibrium with some rings of neighbours, everything outside prescribed. Freed are the nodes
    of an element that has all of them on the interface, because nothing else can mend it, and at last the interface
    nodes of every element that is still bad. If an element is inverted even then, the whole field is damped.
    So it is at once if more than a quarter is inverted: such a field says nothing of where its nodes belong.
    InputError if the displacement does not fit or is not finite.
    """
    points, cells = np.asarray(points, float), np.asarray(cells)
    raw = u = np.ascontiguousarray(displacement, float)
    if u.shape != points.shape or not np.isfinite(u).all():
        raise InputError("-", "displacement", f"shape {u.shape} or a value is not finite", "give (n, 3) in mm")
    ratio = jacobians(points, cells, u)
    least = float(ratio.min())
    repair = Repair(least, int((ratio <= 0).sum()), least)
    if least >= FLOOR:
        return u, repair
    fixed, solved = np.array(interface, bool), np.zeros(len(cells), bool)
    for rings, freeing in TRIES if (ratio <= 0).mean() <= TANGLED else ():
        bad = ratio < FLOOR
        if not bad.any():
            break
        kept = fixed.copy()
        kept[cells[bad if freeing else bad & fixed[cells].all(axis=1)]] = False
        region = _grown(cells, bad, rings)
        new = _relaxed(points, cells, material, volumetric, u, region, kept)
        after = jacobians(points, cells, new)
        if (after < FLOOR).sum() < bad.sum():
            u, ratio, fixed, solved = new, after, kept, solved | region
    damping = 1.0
    if ratio.min() <= 0:
        u, damping = max((damped(points, cells, field) for field in (u, raw)), key=lambda pair: pair[1])
        ratio = jacobians(points, cells, u)
    way = np.linalg.norm(u - raw, axis=1)
    return u, replace(
        repair,
        least=float(ratio.min()),
        elements=int(solved.sum()),
        nodes=int((way > 0).sum()),
        interface=int((way > 0)[np.asarray(interface, bool)].sum()),
        change=float(way.max()),
        damping=damping,
    )


def damped(points, cells, displacement) -> tuple[np.ndarray, float]:
    """The field times the largest factor that leaves every J at FLOOR or above, and that factor.

    There is one: J is 1 at rest. Looked for from 1 downwards in steps of 1/64, then by bisection.
    """

    def sound(factor: float) -> bool:
        return jacobians(points, cells, factor * displacement).min() >= FLOOR

    high = 1.0
    while not sound(low := high - 1 / 64 if high > 1 / 32 else high / 2):
        high = low
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if sound(middle) else (low, middle)
    return low * displacement, low


def _grown(cells, chosen, rings: int) -> np.ndarray:
    """Elements (m,) bool within so many rings of the chosen ones; neighbours share a node."""
    for _ in range(rings):
        touched = np.zeros(cells.max() + 1, bool)
        touched[cells[chosen]] = True
        chosen = touched[cells].any(axis=1)
    return chosen


def _relaxed(points, cells, material, volumetric, displacement, region, fixed) -> np.ndarray:
    """The displacement (n, 3) with the elements `region` (m,) in equilibrium, as far as the solver gets; nodes `fixed`
    (n,) and those that other elements share stay where they are."""
    fixed = fixed.copy()
    fixed[cells[~region]] = True
    nodes, local = np.unique(cells[region], return_inverse=True)
    prescribed = np.flatnonzero(fixed[nodes])
    moved = displacement.copy()
    if len(prescribed) == len(nodes):
        return moved
    law = Material(material.mu[region], material.lam[region], material.stiffening[region], material.extension)
    boundary = BoundaryConditions(prescribed, moved[nodes[prescribed]])
    options = replace(OPTIONS, volumetric=volumetric)
    try:
        result = solve(points[nodes], local.reshape(-1, 4), law, boundary, options, moved[nodes])
    except InputError:  # nothing constrains the part
        return moved
    moved[nodes] = result.displacement
    return moved
