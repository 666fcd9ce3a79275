"""How the bones of one patient hang together: what follows a moved segment, the final occlusion, what collides."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.bones import of_segments, segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, known_role, of_role
from pinnochio.plans.sampling import LIMITS, JawAnatomy, composed, ramus_following
from pinnochio.plans.surgery import segment_in_words

OVERJET, OVERBITE = 2.5, 2.0  # mm of a normal bite [R]
EDGE = 8.0  # mm behind the foremost point of a jaw: its incisors [I]
DEEPER = 1.0  # mm that bones run into each other beyond what they did before surgery: less is the surface's [I]
REACH = 6.0  # mm: a point deeper in a bone than this is not told from one on its far side [I]
# mm of overlap up to which nothing is wrong, by its kind: what is trimmed where a jaw is cut, what is removed of the
# skull above an upper jaw, teeth, other bones. Of 40 virtual plans the middle and the largest are 3.0 and 5.0 of 66
# splits, 2.9 and 5.9 of 38 upper jaws, 0 and 2.7 of 38 bites, 0 and 2.8 of 66 rami at the skull [X].
LIMIT = {"cut": 5.0, "removed": 5.0, "teeth": 2.0, "bone": 3.0}
FOSSA = 2.0  # mm from its place up to which a condyle is in it [I]; in these plans 1.3 at most
CRANIUM = "cranium"
MAXILLA, LOWER = "maxilla", ("distal", UNCUT)


class Jaws:
    """The skeleton of a patient as the planner moves it."""

    def __init__(self, patient: PatientModel):
        self.patient, self.segments = patient, patient.segments
        known = [index for index, name in enumerate(self.segments) if known_role(name)]
        index = np.full(len(self.segments) + 1, -1)
        index[known] = np.arange(len(known))
        names = tuple(self.segments[bone] for bone in known)
        self.anatomy = JawAnatomy.from_points(patient.bone_points, index[patient.bone_segment], names)
        self.middle = {name: bone.mean(axis=0) for name, bone in segment_points(patient).items()}
        self.pivots = self.middle | self.anatomy.hinge  # what a segment turns about unless something else is said
        self.upper, self.lower = (of_role(self.segments, *roles) for roles in ((MAXILLA,), LOWER))
        self.chin, self.rami = of_role(self.segments, "chin"), of_role(self.segments, "proximal")
        self._edges = self._incisors()
        self._trees = {}
        for index, name in enumerate((*self.segments, CRANIUM)):
            bone = patient.bone_segment == (index if name != CRANIUM else -1)
            if bone.any():
                points = patient.bone_points[bone]
                self._trees[name] = points, patient.bone_normals[bone], cKDTree(points)
        self._touching = {pair: self._depth(*pair, RigidMotion()) for pair in self._pairs()}

    def followers(self, segment: str, locked: bool) -> list[str]:
        """Segments that take the same step as a moved one: chin with its mandible; if locked, jaw with jaw."""
        jaws = [*self.upper, *self.lower] if locked and segment in (*self.upper, *self.lower) else [segment]
        moved = [*jaws, *(self.chin if any(name in self.lower for name in jaws) else [])]
        return [name for name in dict.fromkeys(moved) if name != segment]

    def carried(self, plan: Plan, before: Plan) -> dict[str, RigidMotion]:
        """Motions of the rami that follow the mandible from one plan to another: each turns about its condyle.

        What a ramus does beside that, by its own motion in the plan before, it keeps.
        """
        if not self.lower:
            return {}
        body, moved = self.lower[0], {}
        for name in self.rami:
            old, new = (ramus_following(self.anatomy, name, each.motion(body)) for each in (before, plan))
            moved[name] = self.step(old, new, before.motion(name))
        return moved

    def step(self, before: RigidMotion, after: RigidMotion, local: RigidMotion) -> RigidMotion:
        """A motion `own` after the step that takes another segment from `before` to `after`."""
        return composed(after, composed(before.back, local, local.pivot), local.pivot)

    def final(self, plan: Plan, relation: RigidMotion | None) -> RigidMotion | None:
        """Motion of the mandible into its final occlusion with the maxilla of a plan; None without both jaws.

        relation: of the mandible to an unmoved maxilla, as another plan has it; None for the bite that puts the lower
        incisors OVERJET behind and OVERBITE above the upper ones, without a turn.
        """
        if not self.lower or self._edges is None:
            return None
        pivot = plan.motion(self.lower[0]).pivot
        if relation is None:
            upper, lower = self._edges
            relation = RigidMotion(translation=upper + [0, OVERJET, OVERBITE] - lower)
        jaw = plan.motion(self.upper[0]) if self.upper else RigidMotion()
        return composed(jaw, relation, pivot)

    def relation(self, plan: Plan) -> RigidMotion | None:
        """The mandible's motion seen from the maxilla of a plan; None where neither moves or there is no mandible."""
        if not self.lower or Plan("", {name: plan.motion(name) for name in (*self.upper, *self.lower)}).still:
            return None
        jaw = plan.motion(self.upper[0]) if self.upper else RigidMotion()
        mandible = plan.motion(self.lower[0])
        return composed(jaw.back, mandible, mandible.pivot)

    def collisions(self, plan: Plan) -> tuple[dict[tuple[str, str], float], np.ndarray]:
        """How deep (mm) bones run into each other beyond what they did before surgery, by pairs of segments, one the
        CRANIUM perhaps, and the points (k, 3) mm where it is more than LIMIT.

        A point is inside another bone if it lies behind the nearest place of its surface; no deeper than REACH.
        """
        deep, where = {}, [np.zeros((0, 3))]
        for one, other in self._pairs():
            motion = composed(plan.motion(other).back, plan.motion(one), plan.motion(one).pivot)
            depth = self._depth(one, other, motion)
            beyond = depth - np.maximum(self._touching[one, other], 0)
            if (inside := beyond > DEEPER).any():
                deep[one, other] = float(depth[inside].max())
                if deep[one, other] > LIMIT[self.kind(one, other)]:
                    where.append(plan.motion(one).apply(self._trees[one][0][inside]))
        return deep, np.vstack(where)

    def kind(self, *pair: str) -> str:
        """Which of LIMIT an overlap of two bones is."""
        lower, upper, skull = ({*pair} & {*names} for names in (self.lower, self.upper, (CRANIUM,)))
        if lower and {*pair} & {*self.rami, *self.chin}:
            return "cut"
        if upper and skull:
            return "removed"
        return "teeth" if lower and (upper or (skull and not self.upper)) else "bone"

    def luxated(self, plan: Plan) -> dict[str, float]:
        """How far (mm) condyles are out of their place, by ramus or uncut mandible, where that is more than FOSSA."""
        off = {name: float(np.linalg.norm(plan.motion(name).displacement(place[None])))
               for name, place in self.anatomy.hinge.items()}  # fmt: skip
        return {name: distance for name, distance in off.items() if distance > FOSSA}

    def beyond(self, plan: Plan) -> dict[str, list[str]]:
        """By segment the parts of its motion (names of plans.surgery.AMOUNTS) that lie beyond what is practised."""
        far = {}
        for name in self.segments:
            limits = "maxilla" if name in self.upper else "distal" if name in (*self.lower, *self.chin) else None
            if limits is None:
                continue
            shift, turn = LIMITS[limits]
            motion = plan.motion(name)
            # The limits hold at the segment's own middle, wherever it turns about.
            local = motion.about(self.middle[name])
            left, back, up = local.translation
            parts = {"left": (left, *shift[0]), "advance": (-back, *shift[1]), "up": (up, *shift[2])}
            parts |= {key: (value, -most, most) for key, value, most in
                      zip(("pitch", "roll", "yaw"), local.degrees, turn, strict=True)}  # fmt: skip
            if outside := [key for key, (value, low, high) in parts.items() if not low - 1e-6 <= value <= high + 1e-6]:
                far[name] = outside
        return far

    def _pairs(self) -> list[tuple[str, str]]:
        """Pairs of segments that can run into each other: all but pieces of one jaw that are cut from one another."""
        names = [name for name in (*self.segments, CRANIUM) if name in self._trees]
        return [pair for pair in combinations(names, 2) if not {*pair} <= {*self.upper}]

    def _depth(self, one: str, other: str, motion: RigidMotion) -> np.ndarray:
        """Depth (k,) mm of the points of a bone below the surface of another, in whose frame the motion takes them."""
        points, (surface, normals, tree) = motion.apply(self._trees[one][0]), self._trees[other]
        distance, nearest = tree.query(points, distance_upper_bound=REACH)
        near = np.isfinite(distance)
        depth = np.full(len(points), -np.inf)
        place = nearest[near]
        depth[near] = -np.einsum("kx,kx->k", points[near] - surface[place], normals[place])
        return depth

    def _incisors(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Edges (3,) mm of the upper and the lower incisors; None without bone of both jaws."""
        patient = self.patient
        lower = of_segments(patient.bone_segment, self.segments, *LOWER)
        upper = of_segments(patient.bone_segment, self.segments, MAXILLA)
        if not lower.any() or not upper.any():
            return None
        edges = []
        for jaw, lowest in ((upper, True), (lower, False)):
            points = patient.bone_points[jaw]
            middle = 0.5 * (points[:, 0].min() + points[:, 0].max())
            front = points[np.abs(points[:, 0] - middle) < 2 * EDGE]
            heights = front[:, 2]
            end = heights.min() if lowest else heights.max()
            teeth = front[np.abs(heights - end) < EDGE / 2]
            edges.append(teeth[np.argsort(teeth[:, 1])[: max(3, len(teeth) // 10)]].mean(axis=0))
        return edges[0], edges[1]


def plan_with(plan: Plan, motions: Mapping[str, RigidMotion]) -> Plan:
    """The plan with other motions of some segments."""
    return Plan(plan.case, {**plan.motions, **motions})


def named(depths: Mapping[tuple[str, ...], float]) -> str:
    """Segments, or pairs of them, in words, each with its mm."""
    return ", ".join(f"{' / '.join(map(segment_in_words, names))} {depth:.1f} mm" for names, depth in depths.items())
