"""Surgical plans: one rigid motion per bone segment, in LPS millimetres."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinnochio.errors import InputError
from pinnochio.files import replacing
from pinnochio.geometry.rigid import LARGEST_TRANSLATION, RigidMotion

CONVENTION = "x_post = R (x_pre - pivot) + pivot + translation"


@dataclass(frozen=True)
class Plan:
    """Motions by segment name; a segment that the plan does not name stays where it is."""

    case: str
    motions: dict[str, RigidMotion]

    def motion(self, segment: str) -> RigidMotion:
        """The segment's motion, the identity if the plan does not name it."""
        return self.motions.get(segment, RigidMotion())

    def to_json(self) -> str:
        """The plan as the JSON text that :meth:`from_json` reads."""
        segments = {
            name: {
                "rotation": motion.rotation.tolist(),
                "translation": motion.translation.tolist(),
                "pivot": motion.pivot.tolist(),
            }
            for name, motion in sorted(self.motions.items())
        }
        head = {"case": self.case, "frame": "LPS", "units": "mm", "convention": CONVENTION}
        return json.dumps(head | {"segments": segments}, indent=1)

    @classmethod
    def from_json(cls, text: str, file: object = "plan", case: str | None = None) -> "Plan":
        """Read and check a plan; raises InputError that names what is wrong."""
        name = case or "?"

        def refuse(problem: str, remedy: str):
            raise InputError(name, file, problem, remedy)

        try:
            data = json.loads(text)
        except json.JSONDecodeError as error:
            refuse(f"is not JSON ({error})", "write the plan as README.md shows")
        if not isinstance(data, dict) or not isinstance(data.get("segments"), dict):
            refuse("has no 'segments' object", "write the plan as README.md shows")
        for key, expected in (("frame", "LPS"), ("units", "mm"), ("convention", CONVENTION)):
            if data.get(key, expected) != expected:
                refuse(f"{key} is {data[key]!r}", f"convert the plan to {key} {expected!r}")
        if case is not None and data.get("case", case) != case:
            refuse(f"belongs to case {data['case']!r}", "give each case its own plan")
        motions = {}
        for segment, entry in data["segments"].items():
            try:
                motion = RigidMotion(
                    np.array(entry["rotation"], float).reshape(3, 3),
                    np.array(entry["translation"], float).reshape(3),
                    np.array(entry.get("pivot", [0, 0, 0]), float).reshape(3),
                )
            except (KeyError, TypeError, ValueError):
                refuse(
                    f"segment {segment!r} needs rotation (3x3), translation (3) and, if wanted, pivot (3)",
                    "write all numbers of the motion",
                )
            numbers = np.concatenate([motion.rotation.ravel(), motion.translation, motion.pivot])
            if not np.isfinite(numbers).all():
                refuse(f"segment {segment!r} holds a number that is not finite", "write finite numbers")
            rotation = motion.rotation
            if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
                refuse(f"rotation of segment {segment!r} is not a rotation", "store R with R'R = I, det R = 1")
            if np.linalg.norm(motion.translation) > LARGEST_TRANSLATION:
                refuse(
                    f"translation of segment {segment!r} is {np.linalg.norm(motion.translation):.0f} mm",
                    f"write translations in millimetres ({LARGEST_TRANSLATION:.0f} at most)",
                )
            motions[segment] = motion
        return cls(data.get("case", name), motions)

    @classmethod
    def read(cls, path: str | os.PathLike, case: str) -> "Plan":
        """Read the plan of `case` from a JSON file, or from a folder of ITK / 3D Slicer transforms, one per segment."""
        if Path(path).is_dir():
            from pinnochio.plans.transforms import read_transforms  # needs ITK, which training does without

            return cls(case, read_transforms(path, case))
        return cls.from_json(Path(path).read_text(encoding="utf-8"), path, case)

    def write(self, path: str | os.PathLike) -> None:
        """Write the plan as JSON."""
        with replacing(path) as temporary:
            temporary.write_text(self.to_json() + "\n", encoding="utf-8")
