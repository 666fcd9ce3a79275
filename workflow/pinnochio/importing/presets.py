"""What free segmentation tools write: the voxel values of each, and which part of a head each structure is.

Values as in the tools' own sources [S]: SlicerDentalSegmentator (SegmentationWidget.py, order of the labels),
SlicerAutomatedDentalTools (BATCHDENTALSEG, SegmentationWidget.py; AMASSS_CLI.py, LABELS), TotalSegmentator
(map_to_binary.py: head_muscles; craniofacial_structures as listed in its order by programs that read it).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

# Parts of a head. Bone is cut into segments later; teeth and canal belong to the bone that holds them.
SKULL, MANDIBLE, UPPER_TEETH, LOWER_TEETH, CANAL = 1, 2, 3, 4, 5
SOFT, HEAD, MUSCLE, NOTHING = 6, 7, 8, 9  # soft tissue; all inside the skin that is nothing else; muscle; left out
UPPER, LOWER = (SKULL, UPPER_TEETH), (MANDIBLE, LOWER_TEETH, CANAL)
# Pieces that a surgeon has cut already, beside what any tool writes; and the bone that each part is of.
PIECES = {"lefort1": 10, "mandible_distal": 11, "proximal_left": 12, "proximal_right": 13, "chin": 14}
BONE_OF = np.array([*range(10), SKULL, *[MANDIBLE] * 4], np.uint8)
TEETH = {"upper_teeth": UPPER_TEETH, "lower_teeth": LOWER_TEETH, "mandibular_canal": CANAL}
# Other names of structures, as the tools' modules for 3D Slicer write them [R].
OTHER_NAMES = {
    **dict.fromkeys(("maxillaupperskull", "upperskullmaxilla", "skull"), "upper_skull"),
    **{"mandible": "MAND", "cranialbase": "CB", "upperairway": "UAW", "maxilla": "MAX"},
    **{"cervicalvertebra": "CV", "cervicalvertebrae": "CV"},
}
TOOTH = ("central incisor", "lateral incisor", "canine", "first premolar", "second premolar")
TOOTH += ("first molar", "second molar", "third molar")


@dataclass(frozen=True)
class Preset:
    """A tool: its label maps by kind, each with the structure that a voxel value means; the part of each structure.

    A file of one structure alone bears the structure's name. sides: pairs of structures, left and right.
    """

    maps: Mapping[str, Mapping[int, str]]
    parts: Mapping[str, int]

    def structure(self, name: str) -> str | None:
        """The structure that a segment of this name is, without regard to case, blanks and signs."""
        words = name.lower()
        for number, tooth in enumerate(TOOTH, 1):
            words = words.replace(tooth, str(number))
        words = re.sub(r"[\W_]", "", words)
        known = {re.sub(r"[\W_]", "", part.lower()): part for part in self.all_parts}
        other = OTHER_NAMES.get(words)
        return known.get(words, other if other in self.parts else None)

    @property
    def all_parts(self) -> dict[str, int]:
        """The part of each structure, of the skin, and of pieces that are cut already."""
        return {"skin": HEAD, **self.parts, **PIECES}

    @property
    def sides(self) -> list[tuple[str, str]]:
        """Structures that lie on the left, each with its counterpart on the right."""
        pairs = [(name, name.replace("left", "right")) for name in self.all_parts if "left" in name]
        return [pair for pair in pairs if pair[1] in self.all_parts]


def _one_map(**parts: int) -> Preset:
    """A tool of one label map, whose values count from 1."""
    return Preset({"": dict(enumerate(parts, 1))}, parts)


def _universal() -> Preset:
    """Teeth in the universal numbering: from the upper right third molar to the upper left, then back below."""
    sets = (("upper_right", 8), ("upper_left", 8), ("lower_left", 8), ("lower_right", 8))
    sets += tuple((f"{side}_primary", 5) for side in ("upper_right", "upper_left", "lower_left", "lower_right"))
    names = []
    for side, count in sets:
        outward = range(1, count + 1)  # numbered from the middle
        order = reversed(outward) if side.startswith(("upper_right", "lower_left")) else outward
        names += [f"{side}_{number}" for number in order]
    parts = {name: UPPER_TEETH if name.startswith("upper") else LOWER_TEETH for name in names}
    return _one_map(**parts, mandible=MANDIBLE, maxilla=SKULL, mandibular_canal=CANAL)


def _totalsegmentator() -> Preset:
    bones = ("mandible", "teeth_lower", "skull", "head", "sinus_maxillary", "sinus_frontal", "teeth_upper")
    parts = dict(zip(bones, (MANDIBLE, LOWER_TEETH, SKULL, HEAD, NOTHING, NOTHING, UPPER_TEETH), strict=True))
    sided = ("masseter", "temporalis", "lateral_pterygoid", "medial_pterygoid")
    muscles = [f"{name}_{side}" for name in sided for side in ("right", "left")]
    muscles += ["tongue", "digastric_right", "digastric_left"]
    # The tongue is left out, as the rest of what lies between the dental arches: jaws are modelled with air between.
    parts |= {name: NOTHING if name == "tongue" else MUSCLE for name in muscles}
    maps = {"craniofacial_structures": dict(enumerate(bones, 1)), "head_muscles": dict(enumerate(muscles, 1))}
    return Preset(maps, parts)


PRESETS = {
    "dentalsegmentator": _one_map(upper_skull=SKULL, mandible=MANDIBLE, **TEETH),
    "nasomaxilla": _one_map(upper_skull=SKULL, mandible=MANDIBLE, maxilla=SKULL, **TEETH),
    "universal": _universal(),
    "amasss": _one_map(MAND=MANDIBLE, CB=SKULL, UAW=NOTHING, MAX=SKULL, CV=NOTHING, SKIN=HEAD),
    "totalsegmentator": _totalsegmentator(),
}
