"""Surgical plans: one rigid motion per bone segment, in LPS millimetres."""

import json
import logging
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinnochio.errors import refusal
from pinnochio.files import replacing
from pinnochio.geometry.rigid import LARGEST_TRANSLATION, NEARLY, RigidMotion, nearest_rotation
from pinnochio.json_text import check_keys, numbers, parse_json, read_text

LOG = logging.getLogger(__name__)
TRANSFORM_FORMATS = (".tfm", ".txt", ".h5", ".mat")
CONVENTION = "x_post = R (x_pre - pivot) + pivot + translation"
KEYS = ("case", "frame", "units", "convention", "segments", "warnings")
MOTION_KEYS = ("rotation", "translation", "pivot")
ROUNDED = 1e-6  # of R'R = I from which a rotation is made one, and that is said
NOTHING = 1e-9  # mm, and of the entries of a rotation: rounding
FARTHEST = 1e4  # mm; no scanner's origin lies farther from the head


@dataclass(frozen=True)
class Plan:
    """Motions by segment name; a segment that the plan does not name stays where it is. warnings: of its import."""

    case: str
    motions: dict[str, RigidMotion]
    warnings: tuple[str, ...] = ()

    def motion(self, segment: str) -> RigidMotion:
        """The segment's motion, the identity if the plan does not name it."""
        return self.motions.get(segment, RigidMotion())

    @property
    def still(self) -> bool:
        """Whether no bone moves."""
        turned = [np.abs(motion.rotation - np.eye(3)).max() for motion in self.motions.values()]
        shifted = [np.abs(motion.translation).max() for motion in self.motions.values()]
        return max([*turned, *shifted], default=0.0) < NOTHING

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
        said = {"warnings": self.warnings} if self.warnings else {}
        return json.dumps(head | {"segments": segments} | said, indent=1)

    @classmethod
    def from_json(cls, text: str, file: object = "plan", case: str | None = None, foreign: bool = False) -> "Plan":
        """Read and check a plan; raises InputError that names what is wrong.

        foreign: the text may name another case than `case`, whose plan it becomes.
        """
        name = case or "?"

        refuse = refusal(name, file)
        data = parse_json(text, refuse)
        if not isinstance(data, dict) or not isinstance(data.get("segments"), dict):
            refuse("has no 'segments' object", "write the plan as README.md shows")
        check_keys(data, KEYS, "", refuse)
        for key, expected in (("frame", "LPS"), ("units", "mm"), ("convention", CONVENTION)):
            if data.get(key, expected) != expected:
                refuse(f"{key} is {data[key]!r}", f"convert the plan to {key} {expected!r}")
        if not isinstance(data.get("case", name), str):
            refuse(f"its case is {data['case']!r}", "write the name of the case as text")
        if case is not None and data.get("case", case) != case and not foreign:
            refuse(f"belongs to case {data['case']!r}", "give each case its own plan")
        motions = {}
        for segment, entry in data["segments"].items():
            if not isinstance(entry, dict):
                refuse(f"segment {segment!r} is no object", "give it rotation, translation and pivot")
            check_keys(entry, MOTION_KEYS, f"segment {segment!r}: ", refuse)
            parts = [entry.get(key, None if key != "pivot" else [0, 0, 0]) for key in MOTION_KEYS]
            if not (numbers(parts[0], 3, 3) and numbers(parts[1], 3) and numbers(parts[2], 3)):
                problem = f"segment {segment!r} needs rotation (3x3), translation (3) and, if wanted, pivot (3)"
                refuse(problem, "write all numbers of the motion as numbers")
            stored, *places = (np.array(part, float) for part in parts)
            rotation, off = nearest_rotation(stored)
            if not off <= NEARLY:
                refuse(f"rotation of segment {segment!r} is not a rotation", "store R with R'R = I, det R = 1")
            if off > ROUNDED:
                said = "rotation of %r is rounded (R'R differs from I by %.1g); made one"
                LOG.warning(f"case %r: %s: {said}", name, file, segment, off)
            motion = RigidMotion(stored if off <= ROUNDED else rotation, *places)
            if not np.linalg.norm(motion.translation) <= LARGEST_TRANSLATION:
                problem = f"translation of segment {segment!r} is {np.linalg.norm(motion.translation):.0f} mm"
                refuse(problem, f"write translations in millimetres ({LARGEST_TRANSLATION:.0f} at most)")
            if not np.abs(motion.pivot).max() <= FARTHEST:
                problem = f"pivot of segment {segment!r} lies {np.abs(motion.pivot).max():.3g} mm from the origin"
                refuse(problem, "write the pivot in millimetres in the frame of the scan")
            motions[segment] = motion
        said = data.get("warnings", [])
        if not isinstance(said, list) or not all(isinstance(words, str) for words in said):
            refuse("its warnings are no list of texts", "leave them out")
        return cls(name if foreign else data.get("case", name), motions, tuple(said))

    @classmethod
    def read(cls, path: str | os.PathLike, case: str, foreign: bool = False) -> "Plan":
        """Read the plan of `case` from a JSON file, or from a folder of ITK / 3D Slicer transforms, one per segment.

        foreign: the file may name another case.
        """
        if Path(path).is_dir() or str(path).lower().endswith(TRANSFORM_FORMATS):
            from pinnochio.plans.transforms import read_transforms  # needs ITK, which training does without

            return cls(case, read_transforms(path, case))

        refuse = refusal(case, path)
        return cls.from_json(read_text(path, refuse), path, case, foreign)

    def write(self, path: str | os.PathLike) -> None:
        """Write the plan as JSON."""
        with replacing(path) as temporary:
            temporary.write_text(self.to_json() + "\n", encoding="utf-8")
