"""Two plans of one patient while somebody edits them: motions, presets, undo, opening, saving."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError
from pinnochio.files import check_name
from pinnochio.geometry.rigid import LARGEST_TRANSLATION, RigidMotion
from pinnochio.importing.segmentation import check_travel
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import FARTHEST, Plan
from pinnochio.plans.surgery import AMOUNTS, amounts, motion_of, near_bone
from pinnochio.plans.transforms import write_transforms
from studies.planner.jaws import Jaws, plan_with

SIDES = ("A", "B")
LARGEST_TURN = 90.0  # degrees about an axis; no bone is turned farther
REST = "nothing moved"  # no file bears a name with a space
# What a preset moves and how far, mm; a mandible that is "final" goes into its final occlusion afterwards.
PRESETS = {
    "Le Fort I advance 5 mm": {"maxilla": {"advance": 5.0}},
    "Le Fort I impact 3 mm": {"maxilla": {"up": 3.0}},
    "Mandibular advance 5 mm": {"lower": {"advance": 5.0}},
    "Mandibular setback 5 mm": {"lower": {"advance": -5.0}},
    "Bimaxillary: Le Fort I advance 4 mm, final occlusion": {"maxilla": {"advance": 4.0}, "lower": "final"},
    "Chin advance 4 mm": {"chin": {"advance": 4.0}},
}


class Draft:
    """A plan with what it was before and, after an undo, what it will be again."""

    def __init__(self, plan: Plan):
        self._plans, self._place, self._kind = [plan], 0, None

    @property
    def plan(self) -> Plan:
        """The plan as it stands."""
        return self._plans[self._place]

    @property
    def can_undo(self) -> bool:
        """Whether there is something to undo."""
        return self._place > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is something to do again."""
        return self._place < len(self._plans) - 1

    def change(self, plan: Plan, kind: object = None) -> None:
        """Put another plan in place. Changes of one `kind` in a row are one step of undo, unless it is None."""
        if kind is None or kind != self._kind:
            self._place += 1
        self._plans[self._place :] = [plan]
        self._kind = kind

    def settle(self) -> None:
        """The next change is a step of its own, whatever its kind."""
        self._kind = None

    def undo(self) -> None:
        """Go back one step, where there is one."""
        self._place, self._kind = max(self._place - 1, 0), None

    def redo(self) -> None:
        """Take an undo back, where there is one."""
        self._place, self._kind = min(self._place + 1, len(self._plans) - 1), None


class Session:
    """The plans A and B of a patient, of which `side` is the one that is edited.

    A starts as the first of `plans` (by name), B with nothing moved. With `carry` the mandible takes its chin and, as
    far as they usually follow, its rami along; with `locked` the jaws keep the occlusion that they have. Saved plans go
    to `home`/plans/{name}.json, where `snakemake predict` finds them, and `home`/transforms/{name}/{segment}.tfm for
    3D Slicer.
    """

    def __init__(self, patient: PatientModel, case: str, plans: Mapping[str, Plan], home: str | os.PathLike):
        self.patient, self.case, self.home, self.side = patient, case, Path(home), SIDES[0]
        self.jaws, self.carry, self.locked = Jaws(patient), True, False
        rest = {REST: self._for_hands(Plan(case, {}))}
        self.plans = rest | {name: self._for_hands(plan) for name, plan in plans.items()}
        self._opened = set(plans)
        first = next(iter(plans), REST)
        self.drafts = {side: Draft(self.plans[name]) for side, name in zip(SIDES, (first, REST), strict=True)}
        relations = (self.jaws.relation(plan) for plan in self.plans.values())
        self._occlusion = next((relation for relation in relations if relation is not None), None)

    @property
    def draft(self) -> Draft:
        """The plan that is edited."""
        return self.drafts[self.side]

    @property
    def occlusion(self) -> str:
        """Where the final occlusion comes from, in words."""
        return "incisors 2.5 mm overjet, 2 mm overbite" if self._occlusion is None else "as in the patient's plan"

    @property
    def presets(self) -> list[str]:
        """The presets whose bones this patient has cut."""
        return [name for name, parts in PRESETS.items() if all(self._of(part) for part in parts)]

    def choose(self, side: str) -> None:
        """Edit a side; ValueError where there is no such."""
        if side not in SIDES:
            raise ValueError(f"there is no side {str(side)[:20]!r}")
        self.side = side

    def values(self, segment: str) -> dict[str, float]:
        """Parts of a segment's motion (mm, degrees) in the edited plan, by the names of AMOUNTS."""
        return amounts(self._motion(segment))

    def change(self, segment: str, quantity: str, value: float) -> None:
        """Set one part of a segment's motion; ValueError where it is no number that a bone can move by."""
        known = AMOUNTS.get(quantity)
        most = LARGEST_TRANSLATION if known and known.unit == "mm" else LARGEST_TURN
        if known is None or isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
            raise ValueError(f"{str(quantity)[:20]} of {str(value)[:20]} is not between {-most:g} and {most:g}")
        motion = motion_of(self.values(segment) | {quantity: float(value)}, self._motion(segment).pivot)
        self._put({segment: motion}, (segment, quantity))

    def move_pivot(self, segment: str, pivot) -> None:
        """Let the segment turn about another point (3,) mm from now on; its motion so far stays the same."""
        pivot = np.array(pivot, float)
        if pivot.shape != (3,) or not np.abs(pivot).max() <= FARTHEST:
            raise ValueError(f"a pivot lies within {FARTHEST:g} mm of the origin")
        plan = self.draft.plan
        self.draft.change(plan_with(plan, {segment: self._motion(segment).about(pivot)}), (segment, "pivot"))

    def stay(self, segment: str) -> None:
        """Leave the segment, and what it carries, where they were before surgery."""
        motion = self._motion(segment)
        self._put({segment: RigidMotion(pivot=motion.pivot)})

    def reset(self) -> None:
        """Move nothing."""
        self.draft.change(self.plans[REST])

    def preset(self, name: str) -> None:
        """Start from rest with one of PRESETS; ValueError where this patient has no such bone."""
        if name not in self.presets:
            raise ValueError(f"there is no preset {str(name)[:40]!r}")
        rest, plan = self.plans[REST], self.plans[REST]
        for part, amount in PRESETS[name].items():
            for segment in self._of(part):
                unmoved = rest.motion(segment)
                motion = self.jaws.final(plan, self._occlusion) if amount == "final" else motion_of(
                    dict.fromkeys(AMOUNTS, 0.0) | amount, unmoved.pivot
                )  # fmt: skip
                plan = self._moved(plan, {segment: motion}, locked=False, carry=True)
        self.draft.change(plan)

    def occlude(self) -> None:
        """Put the mandible into its final occlusion under the maxilla as it stands; ValueError without both jaws."""
        motion = self.jaws.final(self.draft.plan, self._occlusion)
        if motion is None:
            raise ValueError("a final occlusion needs a cut mandible and a cut maxilla")
        plan = self.draft.plan
        for segment in self.jaws.lower:
            plan = self._moved(plan, {segment: motion}, locked=False, carry=self.carry)
        self.draft.change(plan)

    def open(self, name: str) -> None:
        """Edit the plan of that name, one of `plans`."""
        if name not in self.plans:
            raise ValueError(f"there is no plan {str(name)[:40]!r}")
        self.draft.change(self.plans[name])

    def take(self, plan: Plan) -> None:
        """Edit a plan that something else has found."""
        self.draft.change(self._for_hands(plan))

    def take_other(self) -> None:
        """Edit what the other side shows."""
        self.draft.change(next(self.drafts[side].plan for side in SIDES if side != self.side))

    def save(self, name: str) -> tuple[Path, Path]:
        """Write the edited plan as JSON and as one transform per segment; returns the file and the folder.

        InputError for a name that a file cannot bear or another plan has, and for a plan that cannot be imported.
        """
        plan, patient, name = self.draft.plan, self.patient, str(name)
        check_name(self.case, name, self.home / "plans")
        file, folder = self.home / f"plans/{name}.json", self.home / f"transforms/{name}"
        saved = name in self.plans and name not in self._opened
        if name in self._opened or (file.exists() and not saved):
            raise InputError(self.case, file, f"there is a plan {name!r} already", "choose another name")
        bone = BoneSurface(patient.bone_points, patient.bone_normals, patient.bone_faces, patient.bone_segment)
        check_travel(plan, bone, patient.segments, file)
        write_transforms(plan.motions, folder)
        plan.write(file)
        self.plans[name] = plan
        return file, folder

    def _motion(self, segment: str) -> RigidMotion:
        if segment not in self.patient.segments:
            raise ValueError(f"there is no segment {str(segment)[:40]!r}")
        return self.draft.plan.motion(segment)

    def _of(self, part: str) -> list[str]:
        """Segments that a preset speaks of."""
        return {"maxilla": self.jaws.upper, "lower": self.jaws.lower, "chin": self.jaws.chin}[part]

    def _put(self, motions: Mapping[str, RigidMotion], kind: object = None) -> None:
        self.draft.change(self._moved(self.draft.plan, motions, self.locked, self.carry), kind)

    def _moved(self, plan: Plan, motions: Mapping[str, RigidMotion], locked: bool, carry: bool) -> Plan:
        """The plan with other motions of some segments and what follows them."""
        new = dict(motions)
        for segment, motion in motions.items():
            for name in self.jaws.followers(segment, locked) if carry or locked else ():
                if carry or name not in self.jaws.chin:
                    new[name] = self.jaws.step(plan.motion(segment), motion, plan.motion(name))
        moved = plan_with(plan, new)
        if carry and set(new) & set(self.jaws.lower):
            rami = self.jaws.carried(moved, plan)
            moved = plan_with(moved, {name: turned for name, turned in rami.items() if name not in motions})
        return moved

    def _for_hands(self, plan: Plan) -> Plan:
        """The same plan with a motion for every segment, each about a pivot that is near its bone."""
        motions = {}
        for segment, pivot in self.jaws.pivots.items():
            motion = plan.motion(segment)
            motions[segment] = near_bone(motion, pivot) if segment in plan.motions else motion.about(pivot)
        return Plan(self.case, motions)
