"""Two plans of one patient while somebody edits them: motions, undo, opening, saving."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError
from pinnochio.files import check_name
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.segmentation import check_travel
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.plans.transforms import write_transforms

SIDES = ("A", "B")
# Translation in mm (LPS), then the rotation vector in degrees.
QUANTITIES = ("x", "y", "z", "pitch", "roll", "yaw")
REST = "nothing moved"  # no file bears a name with a space
# A pivot farther from the middle of its bone than this is of no use to a person who turns the bone, mm.
FARTHEST_PIVOT = 100.0


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

    A starts as the first of `plans` (by name), B with nothing moved. Saved plans go to
    `home`/plans/{name}.json, where `snakemake predict` finds them, and `home`/transforms/{name}/{segment}.tfm for 3D
    Slicer.
    """

    def __init__(self, patient: PatientModel, case: str, plans: Mapping[str, Plan], home: str | os.PathLike):
        self.patient, self.case, self.home, self.side = patient, case, Path(home), SIDES[0]
        self._middles = {
            name: patient.bone_points[patient.bone_segment == index].mean(axis=0)
            for index, name in enumerate(patient.segments)
        }
        rest = {REST: self._for_hands(Plan(case, {}))}
        self.plans = rest | {name: self._for_hands(plan) for name, plan in plans.items()}
        self._opened = set(plans)
        first = next(iter(plans), REST)
        self.drafts = {side: Draft(self.plans[name]) for side, name in zip(SIDES, (first, REST), strict=True)}

    @property
    def draft(self) -> Draft:
        """The plan that is edited."""
        return self.drafts[self.side]

    def values(self, segment: str) -> dict[str, float]:
        """Translation (mm) and rotation (degrees) of a segment in the edited plan, by the names of QUANTITIES."""
        motion = self.draft.plan.motion(segment)
        return dict(zip(QUANTITIES, [*motion.translation.tolist(), *motion.degrees.tolist()], strict=True))

    def change(self, segment: str, quantity: str, value: float) -> None:
        """Set one value of a segment's motion; ValueError where it is no finite number."""
        if not np.isfinite(value):
            raise ValueError(f"{quantity} is {value}")
        values = np.array(list((self.values(segment) | {quantity: value}).values()))
        motion = RigidMotion.from_degrees(values[3:], values[:3], self.draft.plan.motion(segment).pivot)
        self._put(segment, motion, (segment, quantity))

    def move_pivot(self, segment: str, pivot) -> None:
        """Let the segment turn about another point (3,) mm from now on; its motion so far stays the same."""
        pivot = np.array(pivot, float)
        if not np.isfinite(pivot).all():
            raise ValueError(f"pivot is {pivot}")
        self._put(segment, self.draft.plan.motion(segment).about(pivot), (segment, "pivot"))

    def stay(self, segment: str) -> None:
        """Leave the segment where it was before surgery."""
        self._put(segment, RigidMotion(pivot=self.draft.plan.motion(segment).pivot))

    def open(self, name: str) -> None:
        """Edit the plan of that name, one of `plans`."""
        self.draft.change(self.plans[name])

    def take_other(self) -> None:
        """Edit what the other side shows."""
        self.draft.change(next(self.drafts[side].plan for side in SIDES if side != self.side))

    def save(self, name: str) -> tuple[Path, Path]:
        """Write the edited plan as JSON and as one transform per segment; returns the file and the folder.

        InputError for a name that a file cannot bear or another plan has, and for a plan that cannot be imported.
        """
        plan, patient = self.draft.plan, self.patient
        file, folder = self.home / f"plans/{name}.json", self.home / f"transforms/{name}"
        check_name(self.case, name, file)
        own = name in self.plans and name not in self._opened
        if name in self._opened or (file.exists() and not own):
            raise InputError(self.case, file, f"there is a plan {name!r} already", "choose another name")
        bone = BoneSurface(patient.bone_points, patient.bone_normals, patient.bone_faces, patient.bone_segment)
        check_travel(plan, bone, patient.segments, file)
        write_transforms(plan.motions, folder)
        plan.write(file)
        self.plans[name] = plan
        return file, folder

    def _put(self, segment: str, motion: RigidMotion, kind: object = None) -> None:
        plan = self.draft.plan
        self.draft.change(Plan(plan.case, plan.motions | {segment: motion}), kind)

    def _for_hands(self, plan: Plan) -> Plan:
        """The same plan with a motion for every segment, each about a pivot that is near its bone."""
        motions = {}
        for segment, middle in self._middles.items():
            motion = plan.motion(segment)
            far = segment not in plan.motions or np.linalg.norm(motion.pivot - middle) > FARTHEST_PIVOT
            motions[segment] = motion.about(middle) if far else motion
        return Plan(self.case, motions)
