"""What a proposal may change: motions of bones that move by themselves, within bounds, and what they take along."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.mechanics.lift import motion_amplitudes
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import FRONT, UNCUT, of_role
from pinnochio.plans.sampling import JawAnatomy, composed

QUANTITIES = ("left", "forward", "up", "pitch", "roll", "yaw")  # mm, then components of the rotation vector in degrees
LPS = np.array([1.0, -1, 1])  # (left, forward, up) of (x, y, z)
# Which jaws an operation moves, by its name; its bones, if the patient has them, are cut.
OPERATIONS = {
    "two_jaw_chin": {"maxilla", "mandible", "chin"},
    "two_jaw": {"maxilla", "mandible"},
    "mandible_chin": {"mandible", "chin"},
    "mandible": {"mandible"},
    "maxilla_chin": {"maxilla", "chin"},
    "maxilla": {"maxilla"},
    "chin": {"chin"},
}


def operation_in_words(operation: str) -> str:
    """The name of an operation as people read it."""
    jaws = [name for name in ("maxilla", "mandible", "chin") if name in OPERATIONS[operation]]
    return ", ".join(["both jaws", *jaws[2:]] if jaws[:2] == ["maxilla", "mandible"] else jaws)


@dataclass(frozen=True)
class BoneBlock:
    """Bones that move as one: relation, the motion of each before that of the block.

    The block turns about `pivot` (3,) mm and, if it stands `on` another block, before the motion of that one.
    low, high (6,): bounds of QUANTITIES; one that must stay has 0 and 0. kind: the name of its bounds.
    """

    name: str
    kind: str
    pivot: np.ndarray
    relations: Mapping[str, RigidMotion]
    low: np.ndarray
    high: np.ndarray
    on: str = ""

    @property
    def free(self) -> np.ndarray:
        """Which quantities (6,) bool may change."""
        return self.high > self.low


@dataclass(frozen=True)
class Freedom:
    """The motions that are admitted for a patient, as a vector x (p,) of mm and degrees between low and high.

    blocks: each after what it stands on. lever (p,): root mean square motion, in mm, of the bones of its block per
    unit of each parameter.
    """

    model: PatientModel
    blocks: Sequence[BoneBlock]
    centre: np.ndarray = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "centre", self.model.points.mean(axis=0))

    @property
    def names(self) -> list[tuple[str, str]]:
        """Block and quantity of every parameter."""
        return [(block.name, QUANTITIES[i]) for block in self.blocks for i in np.flatnonzero(block.free)]

    @cached_property
    def low(self) -> np.ndarray:
        return np.concatenate([np.zeros(0), *(block.low[block.free] for block in self.blocks)])

    @cached_property
    def high(self) -> np.ndarray:
        return np.concatenate([np.zeros(0), *(block.high[block.free] for block in self.blocks)])

    @cached_property
    def lever(self) -> np.ndarray:
        parts = [np.zeros(0)]
        for block in self.blocks:
            bones = [name for name in block.relations] + [
                name for other in self.blocks if other.on == block.name for name in other.relations
            ]
            index = [self.model.segments.index(name) for name in bones]
            arm = self.model.bone_points[np.isin(self.model.bone_segment, index)] - block.pivot
            turns = [np.sqrt((np.cross(axis, arm) ** 2).sum(axis=1).mean()) for axis in np.eye(3)]
            parts.append(np.array([1.0, 1, 1, *np.radians(turns)])[block.free])
        return np.concatenate(parts)

    def plan(self, case: str, x: np.ndarray) -> Plan:
        """The plan of the parameters x (p,): every segment that a block carries, about a point of its own bone."""
        blocks, motions, done = {}, {}, 0
        for block in self.blocks:
            count = int(block.free.sum())
            values = np.zeros(6)
            values[block.free] = x[done : done + count]
            done += count
            move = RigidMotion.from_degrees(values[3:], LPS * values[:3], block.pivot)
            blocks[block.name] = move = composed(blocks[block.on], move, block.pivot) if block.on else move
            for name, before in block.relations.items():
                motions[name] = composed(move, before, self._middle[name])
        return Plan(case, motions)

    def nearest(self, plan: Plan) -> np.ndarray:
        """Parameters (p,) of the plan where it is admitted, else with what is not admitted left out, block by block."""
        values, blocks = [np.zeros(0)], {}
        for block in self.blocks:
            name, before = next(iter(block.relations.items()))
            whole = composed(plan.motion(name), before.back, block.pivot)
            move = composed(blocks[block.on].back, whole, block.pivot) if block.on else whole
            kept = np.clip(np.concatenate([LPS * move.translation, move.degrees]), block.low, block.high)
            values.append(kept[block.free])
            move = RigidMotion.from_degrees(kept[3:], LPS * kept[:3], block.pivot)
            blocks[block.name] = composed(blocks[block.on], move, block.pivot) if block.on else move
        return np.concatenate(values)

    def amplitudes(self, x: np.ndarray) -> np.ndarray:
        """Amplitudes (12 K,) of the elastic map."""
        return motion_amplitudes(self.plan("-", x), self.model.segments, self.centre)

    def derivative(self, x: np.ndarray, step: float = 1e-3) -> np.ndarray:
        """Derivative (12 K, p) of the amplitudes, by central differences."""
        columns = []
        for place in range(len(x)):
            shift = np.zeros(len(x))
            shift[place] = step
            columns.append((self.amplitudes(x + shift) - self.amplitudes(x - shift)) / (2 * step))
        return np.array(columns).T.reshape(12 * len(self.model.segments), len(x))

    @cached_property
    def _middle(self) -> dict[str, np.ndarray]:
        return {name: points.mean(axis=0) for name, points in segment_points(self.model).items()}


def freedoms(
    model: PatientModel, operations: Iterable[str], bounds: Mapping, occlusion: Plan | None = None
) -> dict[str, Freedom]:
    """As :func:`freedom`, in their order, of the operations that move anything of this patient."""
    admitted = {operation: freedom(model, operation, bounds, occlusion) for operation in operations}
    return {operation: free for operation, free in admitted.items() if free is not None and len(free.low)}


def freedom(model: PatientModel, operation: str, bounds: Mapping, occlusion: Plan | None = None) -> Freedom | None:
    """What an operation (of OPERATIONS) may move; None where the patient lacks a bone that it needs.

    bounds: by kind and quantity (low, high), 0 for what is not named. occlusion: a plan whose relation of the jaws is
    kept, pieces of the maxilla and mandible as one; None leaves each jaw to itself.

    The first piece of a maxilla in pieces stands for the jaw, the others move a little against it. Rami turn about
    their condyles. Where the mandible is left alone it turns with its rami about both condyles, teeth to teeth with
    the maxilla. A chin that is not cut goes with its jaw, and one that is cut moves against it.
    """
    jaws = OPERATIONS[operation]
    segments = model.segments
    pieces = of_role(segments, "maxilla")
    pieces = [name for name in pieces if FRONT in name] + [name for name in pieces if FRONT not in name]
    distal, rami, whole, chin = (of_role(segments, what) for what in ("distal", "proximal", UNCUT, "chin"))
    lower = distal or whole
    if ("maxilla" in jaws and not pieces) or ("mandible" in jaws and not distal) or ("chin" in jaws and not chin):
        return None
    anatomy = JawAnatomy.from_points(model.bone_points, model.bone_segment, segments)
    blocks: list[BoneBlock] = []

    def add(name: str, kind: str, pivot, relations: Mapping[str, RigidMotion], on: str = "", still: bool = False):
        limits = {} if still else bounds[kind]
        low, high = np.array([limits.get(quantity, (0, 0)) for quantity in QUANTITIES], float).T
        blocks.append(BoneBlock(name, kind, pivot, relations, low, high, on))

    rest = RigidMotion()
    upper_pivot = np.mean([anatomy.centre[name] for name in pieces], axis=0) if pieces else None
    with_chin = [] if "chin" in jaws else chin
    hinges = [anatomy.hinge[name] for name in (*rami, *whole)]
    turning = dict.fromkeys([*lower, *(rami if distal else []), *with_chin], rest)
    carrier = ""  # the block that the lower jaw goes with
    if occlusion is not None and "maxilla" in jaws and lower:
        first = occlusion.motion(pieces[0] if "mandible" in jaws else lower[0])
        related = {name: _after(first.back, occlusion.motion(name)) for name in [*pieces, *lower]}
        related |= {name: related[lower[0]] for name in with_chin}
        if "mandible" in jaws:
            add("jaws", "maxilla", upper_pivot, related)
            carrier = "jaws"
        elif hinges:
            add("jaws", "autorotation", np.mean(hinges, axis=0), related | dict.fromkeys(rami, rest))
            carrier = "jaws"
    else:
        for number, name in enumerate(pieces if "maxilla" in jaws else []):
            kind, on = ("piece", pieces[0]) if number else ("maxilla", "")
            add(name, kind, anatomy.centre[name] if number else upper_pivot, {name: rest}, on)
        if "mandible" in jaws and occlusion is not None:
            fixed = occlusion.motion(lower[0])  # against a maxilla that stays
            if pieces:
                fixed = _after(occlusion.motion(pieces[0]).back, fixed)
            add(lower[0], "mandible", anatomy.centre[lower[0]], dict.fromkeys([*lower, *with_chin], fixed), still=True)
            carrier = lower[0]
        elif "mandible" in jaws:
            add(lower[0], "mandible", anatomy.centre[lower[0]], dict.fromkeys([*lower, *with_chin], rest))
            carrier = lower[0]
        elif "maxilla" in jaws and lower and hinges:
            add("mandible_turning", "autorotation", np.mean(hinges, axis=0), turning)
            carrier = "mandible_turning"
    if "mandible" in jaws:
        for name in rami:
            add(name, "proximal", anatomy.hinge[name], {name: rest})
    if "chin" in jaws:
        jaw = next((block.relations[lower[0]] for block in blocks if block.name == carrier), rest) if lower else rest
        add(chin[0], "chin", anatomy.centre[chin[0]], dict.fromkeys(chin, rest), carrier)
        if not np.allclose(jaw.rotation, np.eye(3)) or jaw.translation.any():
            # The chin stands on the teeth of its jaw, which the occlusion has moved before the block moves.
            pivot = jaw.apply(anatomy.centre[chin[0]][None])[0]
            blocks[-1] = replace(blocks[-1], pivot=pivot, relations=dict.fromkeys(chin, jaw))
    return Freedom(model, tuple(blocks)) if blocks else None


def _after(after: RigidMotion, before: RigidMotion) -> RigidMotion:
    """The motion after(before(x))."""
    return composed(after, before, before.pivot)
