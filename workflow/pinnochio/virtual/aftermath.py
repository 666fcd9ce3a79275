"""What surgery does to a face beyond moving bone: lips, chin, nose, posture, swelling, the patient's own response.

Every change is an amount in mm in regions of the face: smooth shapes of fixed size around landmarks, along the local
normal of the skin where nothing else is said; an amount is the mean over the skin where the shape is above half of its
peak. What plan, anatomy and covariates decide stands apart from what they leave open: :data:`DECIDED` holds the first,
:data:`OPEN` the second. Sizes and forms: reality of orthognathic outcomes, with the sources that
:data:`pinnochio.virtual.ground_truth.EFFECTS` names.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.json_text import read_stored_json
from pinnochio.model.labels import AIR
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import displacement_at
from pinnochio.virtual.covariates import AGE, Covariates
from pinnochio.virtual.face_scan import smooth_noise

NORMAL_REACH, NORMAL_NEIGHBOURS = 6.0, 48  # mm over which normals of the skin are averaged [I]
WING = np.array([0.34, 4.0, 4.0])  # wing of the nose from subnasale: share of the mouth's width, then mm [I]
MEAN_OF_HALF = 0.5 / np.log(2)  # mean of a Gaussian over the disc where it is above half of its peak
ROOT, RIM = 0.35, 0.25  # of the height of the nose: what stays below the nasion, and over what it then gets loose [I]
LIP_DEPTH = 4.0  # mm behind the lips' fronts where they meet [I]
WIDEST_GAP = 8.0  # mm of gaping lips beyond which nothing changes [I]
SWELLING_AT_6 = 39.54 - 13.14 * np.log(6)  # % of the swelling [S: PMID 34619733]
SIDES = {"left": 1.0, "right": -1.0}
# mm, SD over patients of what is left of the response once plan and thickness are known: at lips and chin as published
# [S: n = 57, 62: 1.3 to 1.65 with measuring error; chin 0.8], elsewhere [I].
RESPONSE = {
    "upper_lip": 1.0,
    "lower_lip": 1.25,
    "mentolabial": 0.6,
    "chin": 1.0,
    "dorsum": 0.5,
    "wing": 0.3,
    "paranasal": 0.6,
    "infraorbital": 0.5,
    "malar": 0.6,
    "cheek": 1.0,
    "jaw": 1.1,
    "submental": 0.9,
}
ON_BOTH_SIDES = 0.8  # correlation of the sides is its square: three real patients' deviations are as symmetric [X]
BROAD, BROAD_LENGTH, MIDDLE = 0.6, 28.0, 12.0  # mm: SD, correlation length, rounding of the mirror plane [I]
RESPONSE_SPREAD = 0.25  # SD of the logarithm of a patient's own level [I]


def read_landmarks(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Landmarks (3,) mm by name."""
    return {name: np.array(place) for name, place in read_stored_json(path).items()}


def bump(points: np.ndarray, centre: np.ndarray, reach) -> np.ndarray:
    """Gaussian (n,) around a centre with SD `reach` mm, one for all axes or (3,)."""
    return np.exp(-0.5 * np.sum(((points - centre) / reach) ** 2, 1))


def lip_gap(labels, spacing, origin, landmarks: Mapping[str, np.ndarray]) -> float:
    """Height (mm) of the air between the lips on the midline, a little behind their fronts."""
    upper, lower = landmarks["labrale_superius"], landmarks["labrale_inferius"]
    front = max(upper[1], lower[1]) + LIP_DEPTH
    column = np.array([(upper[0] + lower[0]) / 2, front, 0.0])
    i, j, _ = np.clip(np.rint((column - origin) / spacing).astype(int), 0, np.array(labels.shape) - 1)
    low, high = (int(np.clip(round((z - origin[2]) / spacing[2]), 0, labels.shape[2])) for z in (lower[2], upper[2]))
    return float((labels[i, j, low:high] == AIR).sum() * spacing[2])


@dataclass(frozen=True)
class Circumstances:
    """What decides the changes of a face.

    Motion of the bone as carried out, mm: maxilla (incisor) forward and up, mandible (incisor) and chin forward;
    thickness: standard deviations from the mean by landmark; gap of the lips before surgery, mm.
    """

    maxilla: float
    impaction: float
    mandible: float
    chin: float
    thickness: Mapping[str, float]
    gap: float
    covariates: Covariates

    @classmethod
    def of(cls, plan: Plan, landmarks, thickness, gap: float, covariates: Covariates) -> "Circumstances":
        """From the motions of a plan, whatever its segments are; bone that it does not cut stays."""
        places = (("upper", "upper_incisor"), ("lower", "lower_incisor"), ("chin", "pogonion_bone"))
        upper, lower, chin = (displacement_at(plan, place, landmarks[point][None])[0] for place, point in places)
        return cls(-upper[1], upper[2], -lower[1], -chin[1], thickness, min(gap, WIDEST_GAP), covariates)


@dataclass(frozen=True)
class Site:
    """Points (n, 3) mm of a head, outer skin (points, faces) and landmarks: where the changes act."""

    points: np.ndarray
    skin: tuple[np.ndarray, np.ndarray]
    landmarks: Mapping[str, np.ndarray]

    @cached_property
    def outward(self) -> np.ndarray:
        """Unit normals (n, 3) of the skin nearest to the points, averaged over some millimetres."""
        normals = vertex_normals(*self.skin)
        away, near = cKDTree(self.skin[0]).query(self.points, min(NORMAL_NEIGHBOURS, len(normals)))
        weight = np.exp(-0.5 * ((away - away[:, :1]) / NORMAL_REACH) ** 2)
        total = np.einsum("nk,nkx->nx", weight, normals[near])
        return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-9)

    @cached_property
    def loose(self) -> np.ndarray:
        """How far skin (n,) moves at all: not at the root of the nose and above, fully below the rim of the orbit."""
        low, high = self.landmarks["subnasale"][2], self.landmarks["nasion"][2]
        return np.clip(((high - self.points[:, 2]) / (high - low) - ROOT) / RIM, 0, 1)

    def shape(self, name: str) -> np.ndarray:
        """Shape (n,) of a region, 1 in the mean over what is above half of its peak."""
        return self.loose * bump(self.points, *self.regions[name]) / MEAN_OF_HALF

    def whole(self, name: str) -> np.ndarray:
        """Shape (n,) of a region, of both its sides where it has two."""
        return np.max([self.shape(side) for side in self.sides(name)], axis=0)

    def sides(self, name: str) -> tuple[str, ...]:
        """The names of a region's shapes: of its left and right side, or its own."""
        return (name,) if name in self.regions else tuple(both({name: 0.0}))

    @cached_property
    def regions(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Centre (3,) and reach (3,) in mm of every shape [I]."""
        marks = self.landmarks
        subnasale, upper, lower = (marks[name] for name in ("subnasale", "labrale_superius", "labrale_inferius"))
        nasion = marks["nasion"]
        width = np.linalg.norm(marks["cheilion_left"] - marks["cheilion_right"])
        wide = 0.4 * width  # of a lip
        regions = {
            "nasal_base": (subnasale, [10, 9, 5]),
            "dorsum": (0.45 * nasion + 0.55 * marks["pronasale"], [9, 14, 9]),
            "upper_lip": (0.65 * upper + 0.35 * subnasale, [wide, 15, 7]),
            "lower_lip": (0.75 * lower + 0.25 * marks["mentolabial"], [wide, 15, 6]),
            "mentolabial": (marks["mentolabial"], [wide, 15, 6]),
            "chin": (marks["pogonion_soft"], [wide, 18, 9]),
            "mouth": ((upper + lower) / 2, [wide, 15, 8]),
            "submental": (marks["menton_soft"] + [0, 18, -2], [30, 22, 16]),
        }
        rise = nasion[2] - subnasale[2]  # height of the nose
        for side, sign in SIDES.items():
            wing = subnasale + WING * [sign * width, 1, 1]
            corner, ear = marks[f"cheilion_{side}"], marks[f"tragus_{side}"]
            regions |= {
                f"wing_{side}": (wing, [8, 8, 9]),
                f"paranasal_{side}": (wing + [sign * 9, 3, 2], [10, 12, 11]),
                f"infraorbital_{side}": (wing + [sign * 15, 8, 0.3 * rise], [13, 13, 8]),
                f"malar_{side}": (0.6 * wing + 0.4 * ear + [0, 0, 0.15 * rise], [16, 18, 12]),
                f"cheek_{side}": (0.6 * corner + 0.4 * ear + [0, 0, 6], [24, 26, 22]),
                f"jaw_{side}": (0.35 * corner + 0.65 * ear + [0, 0, -36], [26, 28, 22]),
            }
        return regions

    def field(self, amounts: Mapping[str, float]) -> np.ndarray:
        """Displacement (n, 3) mm of amounts (mm) in regions: along the normals; of the wings of the nose to their
        side; "mouth" down along the skin."""
        total = np.zeros_like(self.points)
        for name, amount in amounts.items():
            total += amount * self.shape(name)[:, None] * self._direction(name)
        return total

    def _direction(self, name: str) -> np.ndarray:
        if name.startswith("wing_"):
            return np.array([SIDES[name.removeprefix("wing_")], 0, 0])
        if name == "mouth":
            down = np.array([0, 0, -1.0])
            return down - (self.outward @ down)[:, None] * self.outward
        return self.outward


def both(amounts: Mapping[str, float]) -> dict[str, float]:
    """The same amounts on both sides of regions."""
    return {f"{name}_{side}": amount for name, amount in amounts.items() for side in SIDES}


def habitual(c: Circumstances) -> dict[str, float]:
    """What finite elements miss of every patient alike: nose, cheeks and jaw where they did of three real ones [X],
    lips and fold where studies have a mean [S: PMID 34670968, n = 62]; sizes [I]."""
    midline = {"dorsum": -1.3, "upper_lip": 0.5, "lower_lip": -0.6, "mentolabial": 0.4}
    return midline | both({"paranasal": 1.6, "cheek": -1.3, "jaw": 1.4})


def posture(c: Circumstances) -> dict[str, float]:
    """Lying in the CT, upright at the scan."""
    mass, older = c.covariates.mass, 1 + 0.01 * (c.covariates.age - AGE[0])
    sizes = {
        "infraorbital": -0.5 - 0.15 * mass,
        "malar": -1.9 - 0.2 * mass,
        "cheek": 1.1 + 0.2 * mass,
        "jaw": -0.5 - 0.25 * mass,
    }
    return {name: older * amount for name, amount in both(sizes).items()}


def lower_lip(c: Circumstances) -> dict[str, float]:
    advance, setback = max(c.mandible, 0), max(-c.mandible, 0)
    thick = 1 + 0.25 * c.thickness["labrale_inferius"]
    return {"lower_lip": thick * (-0.18 * advance * (1 + 0.1 * c.gap) + 0.08 * setback)}


def chin_pad(c: Circumstances) -> dict[str, float]:
    advance, setback = max(c.chin, 0), max(-c.chin, 0)
    return {"chin": -0.04 * advance + 0.08 * setback, "mentolabial": 0.12 * advance - 0.08 * setback}


def upper_lip(c: Circumstances) -> dict[str, float]:
    share = -0.35 if c.covariates.closure == "vy" else -0.70
    thick = 1 - 0.2 * c.thickness["labrale_superius"]
    return {"upper_lip": c.maxilla * thick * share, "nasal_base": -0.15 * c.maxilla}


def lip_length(c: Circumstances) -> dict[str, float]:
    return {"mouth": 0.8}


def alar_width(c: Circumstances) -> dict[str, float]:
    return both({"wing": (0.18 * c.maxilla + 0.07 * max(c.impaction, 0)) * (0.5 if c.covariates.cinch else 1.0)})


def paranasal(c: Circumstances) -> dict[str, float]:
    return both({"paranasal": 0.08 * c.maxilla})


def swelling(c: Circumstances) -> dict[str, float]:
    left = max(39.54 - 13.14 * np.log(c.covariates.months), 0) / SWELLING_AT_6
    sizes = {"upper_lip": 0.2, "lower_lip": 0.2, "submental": 0.35} | both({"cheek": 0.35, "jaw": 0.45})
    return {name: left * amount for name, amount in sizes.items()}


def masseter_loss(c: Circumstances) -> dict[str, float]:
    more = 1 + 0.2 * c.covariates.mass
    return {name: more * amount for name, amount in ({"submental": -0.3} | both({"jaw": -0.4, "cheek": -0.2})).items()}


# Amounts by region that circumstances decide, by the name of the change.
DECIDED: dict[str, Callable[[Circumstances], dict[str, float]]] = {
    "habitual": habitual,
    "posture": posture,
    "lower_lip": lower_lip,
    "chin_pad": chin_pad,
    "upper_lip": upper_lip,
    "lip_length": lip_length,
    "alar_width": alar_width,
    "paranasal": paranasal,
    "swelling": swelling,
    "masseter_loss": masseter_loss,
}
UNSOURCED = ("habitual",)  # whose size no publication states


def _sides(spreads: Mapping[str, float], site: "Site", rng: np.random.Generator) -> dict[str, float]:
    """Random amounts of these SDs; where a region has two sides they are nearly the same."""
    amounts, alone = {}, np.sqrt(1 - ON_BOTH_SIDES**2)
    for name, spread in spreads.items():
        shared, sides = spread * rng.normal(), site.sides(name)
        if len(sides) == 1:
            amounts[name] = shared
        else:
            amounts |= {side: ON_BOTH_SIDES * shared + alone * spread * rng.normal() for side in sides}
    return amounts


def response(site: Site, moved: np.ndarray, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    """The patient's own response, region by region, and a broad part, mostly the same on both sides."""
    level = np.exp(rng.normal(-(RESPONSE_SPREAD**2) / 2, RESPONSE_SPREAD))
    field = site.field(_sides(RESPONSE, site, rng))
    aside = site.points[:, 0] - site.landmarks["nasion"][0]
    folded = site.points * [0, 1, 1] + np.sqrt(aside**2 + MIDDLE**2)[:, None] * [1.0, 0, 0]
    even, plain = (smooth_noise(points, rng, BROAD_LENGTH) for points in (folded, site.points))
    amount = BROAD * site.loose * (ON_BOTH_SIDES * even + np.sqrt(1 - ON_BOTH_SIDES**2) * plain)
    return level * (field + amount[:, None] * site.outward)


def lengthening(site: Site, moved: np.ndarray, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    """The upper lip lengthens by another amount than the mean."""
    return site.field({"mouth": rng.normal(0, 1.5)})


GAINS = {"upper_lip": 0.12, "lower_lip": 0.12, "paranasal": 0.12, "chin": 0.08, "cheek": 0.05}


def gain(site: Site, moved: np.ndarray, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    """The patient's own gain of the displacement `moved` (n, 3) mm in each region, whole at its middle."""
    total = np.zeros(len(site.points))
    for region, spread in GAINS.items():
        total += rng.normal(0, spread) * MEAN_OF_HALF * site.whole(region)
    return total[:, None] * moved


def swelling_level(site: Site, moved: np.ndarray, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    """Swelling that is more or less than the mean of its month."""
    level = np.exp(rng.normal(-0.125, 0.5)) - 1  # the factor's mean is 1
    return level * site.field(swelling(c))


# Fields (n, 3) mm that nothing known decides, by the name of the change.
OPEN: dict[str, Callable[[Site, np.ndarray, Circumstances, np.random.Generator], np.ndarray]] = {
    "response": response,
    "lengthening": lengthening,
    "gain": gain,
    "swelling_level": swelling_level,
}


def expression(site: Site, rng: np.random.Generator) -> np.ndarray:
    """Another expression at the scan, (n, 3) mm."""
    return site.field(_sides({"upper_lip": 0.3, "lower_lip": 0.4, "cheek": 0.15}, site, rng))
