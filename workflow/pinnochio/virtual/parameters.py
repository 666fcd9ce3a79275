"""The numbers that make one virtual patient, and the distributions from which they are drawn.

Means and spreads are adult figures recalled from anthropometry and cephalometry [R], soft-tissue thicknesses those of
the thickness literature [R]; entries marked [I] are choices.
"""

from dataclasses import dataclass, make_dataclass
from typing import NamedTuple

NORMAL = "normal"
NORMAL_OVERJET = 2.5  # mm [R]
REST_GAP = 2.0  # mm between the incisor edges of a normal bite, jaw at rest [R]


class Distribution(NamedTuple):
    """Truncated normal; `male` is what a man's mean has more than a woman's."""

    mean: float
    sd: float
    low: float
    high: float
    male: float
    unit: str
    source: str
    meaning: str


TABLE = {
    # bone
    "face_height": Distribution(115.0, 5.0, 100, 140, 8.0, "mm", "[R]", "bony nasion to menton"),
    "lower_share": Distribution(0.55, 0.015, 0.50, 0.60, 0.0, "1", "[R]", "part of face_height below the nasal spine"),
    "face_width": Distribution(130.0, 4.5, 115, 152, 7.0, "mm", "[R]", "soft-tissue bizygomatic width"),
    "face_depth": Distribution(87.0, 3.0, 78, 101, 5.0, "mm", "[R]", "tragus to bony nasion, sagittal"),
    "maxilla_position": Distribution(0.0, 2.0, -7, 6, 0.0, "mm", "[R]", "A point ahead of the nasion vertical"),
    "overjet": Distribution(NORMAL_OVERJET, 0.7, -9, 12, 0.0, "mm", "[R]", "upper incisor edge ahead of the lower"),
    "open_bite": Distribution(0.0, 0.3, -0.5, 7, 0.0, "mm", "[R]", "incisor gap beyond the rest gap"),
    "mandible_length": Distribution(72.0, 3.0, 60, 92, 4.5, "mm", "[R]", "gonion to pogonion, sagittal"),
    "ramus_height": Distribution(55.0, 3.0, 44, 70, 5.0, "mm", "[R]", "condyle top to gonion, vertical"),
    "gonial_angle": Distribution(122.0, 5.0, 105, 142, -2.0, "degree", "[R]", "condyle, gonion, pogonion"),
    "gonial_width": Distribution(89.5, 4.0, 77, 112, 9.0, "mm", "[R]", "bony gonion to gonion"),
    "chin_prominence": Distribution(
        0.0, 2.0, -5, 5, 0.5, "mm", "[R]", "pogonion ahead of its mean place below the incisor"
    ),
    "chin_width": Distribution(24.0, 2.5, 17, 36, 5.0, "mm", "[I]", "bony chin between the mental tubercles"),
    "chin_deviation": Distribution(0.0, 0.5, -9, 9, 0.0, "mm", "[R]", "chin off the midline, to the patient's left"),
    "occlusal_cant": Distribution(0.0, 0.4, -4, 4, 0.0, "mm", "[R]", "left jaw angle lower than right by twice this"),
    "brow_prominence": Distribution(0.0, 0.5, -1, 3, 1.6, "mm", "[I]", "brow ridge"),
    # soft tissue
    "eye_spacing": Distribution(62.0, 2.0, 55, 70, 2.0, "mm", "[R]", "between the pupils"),
    # thickness over bone, where thickness.SITES measures it; spreads a tenth below those of 15 orthognathic patients,
    # which hold the error of measuring too [S, I]
    "glabella": Distribution(5.8, 1.1, 3.2, 9, 0.3, "mm", "[R]", "skin over the glabella"),
    "nasion": Distribution(6.9, 1.4, 4.0, 10.5, 0.3, "mm", "[R]", "skin over nasion"),
    "subnasale": Distribution(
        13.3, 2.0, 8.5, 19, 1.0, "mm", "[S: 10.1016/j.forsciint.2018.10.021], less the spine [I]", "subnasale over bone"
    ),
    "mid_philtrum": Distribution(12.0, 2.2, 7.5, 18, 0.9, "mm", "[R]", "middle of the philtrum over the alveolus"),
    "labrale_superius": Distribution(11.4, 2.0, 7.5, 17, 1.0, "mm", "[R]", "upper lip over the incisors"),
    "labrale_inferius": Distribution(12.5, 1.8, 8, 18, 1.0, "mm", "[R]", "lower lip over the incisors"),
    "mentolabial": Distribution(10.7, 1.8, 7, 15.5, 0.6, "mm", "[R]", "fold over B point"),
    "pogonion": Distribution(10.7, 2.1, 6.5, 16.5, 0.6, "mm", "[R]", "chin pad"),
    "menton": Distribution(6.8, 1.7, 3.8, 11.5, 0.4, "mm", "[R]", "under the chin"),
    "zygoma": Distribution(8.6, 1.8, 5, 13.5, 0.0, "mm", "[R]", "over the cheek bone"),
    "masseter": Distribution(17.5, 3.1, 11, 26, 1.0, "mm", "[R]", "over the middle of the ramus"),
    "cheek": Distribution(22.0, 3.6, 14, 32, 0.4, "mm", "[R]", "buccal cheek over the molars"),
}

# What a deformity changes: new means (and spreads), or a shift of the mean marked by "+".
SHIFTS: dict[str, dict[str, tuple]] = {
    "class_ii": {"overjet": (7.5, 1.6, 5.0, 12.0), "mandible_length": ("+", -5.0), "maxilla_position": ("+", 1.0)},
    "class_iii": {
        "overjet": (-4.5, 1.8, -9.0, -1.5),
        "mandible_length": ("+", 4.0),
        "gonial_angle": ("+", 2.0),
        "maxilla_position": ("+", -2.5),
    },
    "asymmetry": {
        "chin_deviation": (6.0, 1.2, 4.0, 9.0),
        "occlusal_cant": (2.0, 0.5, 1.0, 4.0),
        "overjet": (0.0, 2.0, -4.0, 4.0),
    },
    "open_bite": {
        "open_bite": (4.0, 1.0, 2.5, 7.0),
        "ramus_height": ("+", -5.0),
        "gonial_angle": ("+", 6.0),
        "overjet": (3.0, 1.5, 0.0, 6.0),
    },
}


@dataclass(frozen=True)
class Anchors:
    """Where the skull lies below the face, mm.

    tall scales the cranium; heights of nasion, nasal spine and upper incisor edge; how far that edge lies ahead of the
    A point; half width and depth of the upper dental arch; height of pogonion above menton.
    """

    tall: float
    nasion: float
    spine: float
    incisor: float
    incisor_ahead: float
    arch_half_width: float
    arch_depth: float
    chin_height: float


@dataclass(frozen=True)
class Scanned:
    """identity: coordinates (k,) of the face model; normal: the same person before the deformity, None for that one."""

    identity: tuple[float, ...]
    anchors: Anchors
    normal: "HeadParameters | None" = None


# What the face decides; all else is drawn, of the normal person or of the deformity.
FITTED = ("face_height", "lower_share", "face_width", "face_depth", "maxilla_position", "gonial_width",
          "chin_prominence", "eye_spacing")  # fmt: skip
_CLASS = [("deformity", str), ("male", bool), ("scanned", Scanned)]
_Numbers = make_dataclass("_Numbers", [*_CLASS, *((name, float) for name in TABLE)], frozen=True)


class HeadParameters(_Numbers):
    """One virtual patient: its deformity, sex, and every number of :data:`TABLE` by name.

    scanned: the face model's coordinates and what was fitted to them.
    """


def distribution(name: str, male: bool, deformity: str) -> tuple[float, float, float, float]:
    """Mean, standard deviation and bounds of a number for this sex and deformity; NORMAL shifts nothing."""
    entry = TABLE[name]
    mean, sd, low, high = entry.mean + male * entry.male, entry.sd, entry.low, entry.high
    shift = SHIFTS.get(deformity, {}).get(name)
    if shift is None:
        return mean, sd, low, high
    return (mean + shift[1], sd, low, high) if shift[0] == "+" else shift
