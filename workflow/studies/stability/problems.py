"""The problems of the stability sweep: one setting taken to its extreme, all else as usual."""

from dataclasses import dataclass, replace

import numpy as np

from pinnochio.errors import InputError
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.elements.materials import Material, lame
from pinnochio.mechanics.elements.tetrahedra import jacobians, mean_edge
from pinnochio.mechanics.problems import BLOCK, block_boundary, box, uniform
from pinnochio.mechanics.settings import FemSettings
from pinnochio.meshing.mesh import dihedral_cosines
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.plans.plan import Plan

PRECISIONS = ("float64", "float32")
POISSON, YOUNGS_MODULUS = 0.49, 5.0  # of the block, where they are not what is swept; kPa
# Unit ways of a translation, and axes of a rotation through the middle of the segment, LPS.
DIRECTIONS = {
    "forward": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (1.0, 0.0, 0.0),
    "right": (-1.0, 0.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
}
JAWS = "both jaws"
AXES = {"pitch": (1.0, 0.0, 0.0), "roll": (0.0, 1.0, 0.0), "yaw": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Problem:
    """What a user hands over, in one precision: points (n, 3), cells (m, 4), constants, boundary condition.

    Lengths count `millimetres` each. free (f,): nodes without any condition. patient, plan: of which it is the problem,
    if it is one's.
    """

    points: np.ndarray
    cells: np.ndarray
    material: Material
    boundary: BoundaryConditions
    free: np.ndarray
    millimetres: float = 1.0
    patient: PatientModel | None = None
    plan: Plan | None = None

    @property
    def posed(self) -> tuple[np.ndarray, np.ndarray, Material, BoundaryConditions]:
        """What a solver takes: points, cells, constants, boundary condition."""
        return self.points, self.cells, self.material, self.boundary


def movement(model: PatientModel, plan: Plan, fem: FemSettings, arm: str = "mucosa") -> Problem:
    """A patient under a plan; arm: one of `sliding.ARMS`. InputError for an unknown segment."""
    boundary = boundary_conditions(model, plan, arm)
    # Bonded, nodes between two bones follow neither.
    held = boundary.prescribed_nodes if arm == "bonded" else np.flatnonzero(model.node_type != FREE)
    free = np.setdiff1d(np.arange(len(model.points)), held)
    return Problem(model.points, model.cells, fem.material(model.tissue), boundary, free, patient=model, plan=plan)


def moved(model: PatientModel, segment: str, way: str, amount: float) -> Plan:
    """One segment of a patient moved by `amount`: mm in one of DIRECTIONS, or degrees about one of AXES; others stay.
    JAWS: all segments but the rami, together.

    A turn is about the middle of the segment's surface, not the condyles: as the rami stay where they are in this
    sweep, 30 degrees there would take the chin 40 mm away from them.
    """
    if segment == JAWS:
        jaws = [name for name in model.segments if not name.startswith("proximal")]
        return Plan("-", {name: moved(model, name, way, amount).motions[name] for name in jaws})
    if segment not in model.segments:
        raise InputError("-", "configuration", f"there is no segment {segment!r}", f"choose one of {model.segments}")
    if way in DIRECTIONS:
        return Plan("-", {segment: RigidMotion(translation=amount * np.array(DIRECTIONS[way]))})
    bone = model.bone_points[model.bone_segment == model.segments.index(segment)]
    turn = RigidMotion.from_degrees(amount * np.array(AXES[way]), np.zeros(3), bone.mean(axis=0))
    return Plan("-", {segment: turn})


def roughened(model: PatientModel, amplitude: float, rng: np.random.Generator) -> PatientModel:
    """A patient whose bone is rough: each of its points moved along its normal by `amplitude` mm (one SD), the normals
    those of the rough surface."""
    points = model.bone_points + amplitude * rng.normal(size=(len(model.bone_points), 1)) * model.bone_normals
    normals = vertex_normals(points, model.bone_faces)
    bare = np.linalg.norm(normals, axis=1) < 0.5
    normals[bare] = model.bone_normals[bare]
    return replace(model, bone_points=points, bone_normals=normals)


def block(
    steps,
    precision: str = "float64",
    poisson: float = POISSON,
    stiffness: float = 1.0,
    dihedral: float | None = None,
    millimetres: float = 1.0,
) -> Problem:
    """The block problem: bottom fixed on the left, lifted by 8 mm and turned by 5 degrees on the right.

    stiffness: modulus of the upper half over that of the lower. dihedral: smallest dihedral angle in degrees.
    millimetres: length of the unit of all lengths.
    """
    points, cells = box(BLOCK, steps)
    whole = block_boundary(points)
    if dihedral is not None:
        points = flattened(points, cells, steps, dihedral)
    upper = points[cells].mean(axis=1)[:, 2] > BLOCK[2] / 2
    law = uniform(len(cells), poisson)
    if stiffness != 1:
        mu, lam = lame(YOUNGS_MODULUS * np.where(upper, stiffness, 1.0), poisson)
        law = Material(mu, lam, np.zeros(len(cells)))
    free = np.setdiff1d(np.arange(len(points)), whole.prescribed_nodes)
    boundary = BoundaryConditions(
        whole.prescribed_nodes, lambda fraction: (whole.displacement(fraction) / millimetres).astype(precision)
    )
    return Problem((points / millimetres).astype(precision), cells, law, boundary, free, millimetres)


def steps_of(nodes: int) -> tuple[int, int, int]:
    """Cubes along the edges of the block for about so many nodes."""
    edge = (np.prod(BLOCK) / nodes) ** (1 / 3)
    return tuple(max(2, round(length / edge)) for length in BLOCK)


def flattened(points, cells, steps, dihedral: float) -> np.ndarray:
    """Points (n, 3) of a box with every second interior node moved towards a face opposite it, until the smallest
    dihedral angle is `dihedral` degrees, to 1e-9 of itself. InputError if the box has no such node."""
    index = np.stack(np.meshgrid(*(np.arange(n + 1) for n in steps), indexing="ij"), axis=-1).reshape(-1, 3)
    # No two of them share a cell.
    nodes = np.flatnonzero((index % 2 == 1).all(axis=1) & (index < np.array(steps)).all(axis=1))
    if not len(nodes):
        raise InputError("-", "configuration", f"a block of {steps} cubes has no interior node", "take more cubes")
    way = np.zeros_like(points)
    for node in nodes:
        cell = cells[(cells == node).any(axis=1)][0]
        way[node] = points[cell[cell != node]].mean(axis=0) - points[node]
    low, high = 0.0, 1.0  # as far as the face itself
    for _ in range(100):
        middle = (low + high) / 2
        flatter = smallest_dihedral(points + middle * way, cells) > dihedral
        low, high = (middle, high) if flatter else (low, middle)
    return points + low * way


def smallest_dihedral(points, cells) -> float:
    """Smallest dihedral angle of a mesh in degrees."""
    return float(np.degrees(np.arccos(dihedral_cosines(points, cells).max())))


def tangled(problem: Problem, field: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """A displacement (n, 3): `field`, its free nodes on their way to random places about the middle of the mesh, so far
    that `share` of the elements is inverted, or next to it on the near side. InputError if none is.

    Noise alone would keep half of all elements upright, however large it is.
    """
    place, free = problem.points + field, problem.free
    # Half an edge: little enough that going on past the middle turns most elements inside out.
    scatter = 0.5 * mean_edge(problem.points, problem.cells) * rng.normal(size=(len(free), 3)) + place.mean(axis=0)

    def moved(way: float) -> np.ndarray:
        there = np.array(field)
        there[free] += way * (scatter - place[free])
        return there

    def inverted(way: float) -> float:
        return float((jacobians(problem.points, problem.cells, moved(way)) <= 0).mean())

    high = next((way for way in np.linspace(0, 3, 301) if inverted(way) > share), None)
    if high is None:
        problem = f"no start has {100 * share:g} % of its elements inverted"
        raise InputError("-", "configuration", problem, "lower the share, or take more cubes")
    low = max(high - 0.01, 0.0)
    # Not to the last digit, which rounding the field to float32 would undo.
    for _ in range(6):
        middle = (low + high) / 2
        low, high = (middle, high) if inverted(middle) <= share else (low, middle)
    return moved(low)
