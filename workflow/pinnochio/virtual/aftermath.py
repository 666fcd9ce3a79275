"""What surgery does to a face beyond moving bone, as displacement fields: lips, chin, nose, swelling, expression.

Every field is a smooth shape of fixed size around landmarks, along the local normal of the skin where nothing else is
said, times an amount in mm, the mean over the skin where the shape is above half of its peak: a part that plan, anatomy
and covariates decide, and noise. Sizes and forms: reality of orthognathic outcomes, with the sources that
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
from pinnochio.virtual.covariates import Covariates
from pinnochio.virtual.face_scan import smooth_noise

LIP_THICKNESS = 10.0  # mm from bone at which tissue follows fully; none at the bone [I]
NORMAL_REACH, NORMAL_NEIGHBOURS = 6.0, 48  # mm over which normals of the skin are averaged [I]
WING = np.array([0.34, 4.0, 4.0])  # wing of the nose from subnasale: share of the mouth's width, then mm [I]
MEAN_OF_HALF = 0.5 / np.log(2)  # mean of a Gaussian over the disc where it is above half of its peak
LIP_DEPTH = 4.0  # mm behind the lips' fronts where they meet [I]
WIDEST_GAP = 8.0  # mm of gaping lips beyond which nothing changes [I]
SWELLING_AT_6 = 39.54 - 13.14 * np.log(6)  # % of the swelling [S: PMID 34619733]
INDIVIDUAL, INDIVIDUAL_LIPS, INDIVIDUAL_LENGTH = 1.2, 1.4, 15.0  # mm: SD, SD at the lips, correlation length [I]
INDIVIDUAL_SPREAD = 0.25  # SD of its logarithm over patients, who differ as published in how far off they are [I]
SIDES = {"left": 1.0, "right": -1.0}


def read_landmarks(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Landmarks (3,) mm by name."""
    return {name: np.array(place) for name, place in read_stored_json(path).items()}


def looseness(points: np.ndarray, bone_points: np.ndarray) -> np.ndarray:
    """How freely tissue may move against the bone, (n,): 0 at the bone, 1 at the thickness of a lip [I]."""
    return np.clip(cKDTree(bone_points).query(points)[0] / LIP_THICKNESS, 0, 1)


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

    def shape(self, name: str) -> np.ndarray:
        """Shape (n,) of a region, 1 in the mean over what is above half of its peak."""
        return bump(self.points, *self.regions[name]) / MEAN_OF_HALF

    @cached_property
    def regions(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Centre (3,) and reach (3,) in mm of every shape [I]."""
        marks = self.landmarks
        subnasale, upper, lower = (marks[name] for name in ("subnasale", "labrale_superius", "labrale_inferius"))
        width = np.linalg.norm(marks["cheilion_left"] - marks["cheilion_right"])
        wide = 0.4 * width  # of a lip
        regions = {
            "upper_lip": (0.65 * upper + 0.35 * subnasale, [wide, 15, 7]),
            "lower_lip": (0.75 * lower + 0.25 * marks["mentolabial"], [wide, 15, 7]),
            "mentolabial": (marks["mentolabial"], [wide, 15, 6]),
            "chin": (marks["pogonion_soft"], [wide, 18, 9]),
            "mouth": ((upper + lower) / 2, [wide, 15, 8]),
        }
        for side, sign in SIDES.items():
            wing = subnasale + WING * [sign * width, 1, 1]
            corner, ear = marks[f"cheilion_{side}"], marks[f"tragus_{side}"]
            regions |= {
                f"wing_{side}": (wing, [8, 8, 9]),
                f"paranasal_{side}": (wing + [sign * 9, 3, 2], [10, 12, 11]),
                f"cheek_{side}": (0.6 * corner + 0.4 * ear + [0, 0, 6], [28, 28, 26]),
                f"jaw_{side}": (0.35 * corner + 0.65 * ear + [0, 0, -36], [26, 28, 22]),
            }
        regions["submental"] = (marks["menton_soft"] + [0, 18, -2], [30, 22, 16])
        return regions


def _normal(site: Site, amounts: Mapping[str, float]) -> np.ndarray:
    """Field (n, 3) mm of these amounts (mm) in regions, along the normals."""
    return sum(amount * site.shape(name) for name, amount in amounts.items())[:, None] * site.outward


def _both(region: str, common: float, spread: float, rng: np.random.Generator) -> dict[str, float]:
    """An amount for both sides of a region, with noise of SD `spread` of which sides share nine tenths (0.81)."""
    shared = rng.normal()
    return {f"{region}_{side}": common + spread * (0.9 * shared + np.sqrt(0.19) * rng.normal()) for side in SIDES}


def lower_lip(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    advance, setback = max(c.mandible, 0), max(-c.mandible, 0)
    decided = (1 + 0.25 * c.thickness["labrale_inferius"]) * (-0.22 * advance * (1 + 0.1 * c.gap) + 0.08 * setback)
    return _normal(site, {"lower_lip": decided + rng.normal(0, 0.6)})


def chin_pad(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    decided = -0.07 * max(c.chin, 0) + 0.08 * max(-c.chin, 0)
    chin, fold = rng.normal(0, (0.8, 0.4))
    return _normal(site, {"chin": decided + chin, "mentolabial": -decided + fold})


def upper_lip(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    share = 0.10 if c.covariates.closure == "vy" else -0.12
    decided = c.maxilla * (1 - 0.2 * c.thickness["labrale_superius"]) * share
    return _normal(site, {"upper_lip": decided + rng.normal(0, 0.7)})


def lip_length(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    down = np.array([0, 0, -1.0])
    along = down - (site.outward @ down)[:, None] * site.outward
    return (0.8 + rng.normal(0, 1.5)) * site.shape("mouth")[:, None] * along


def alar_width(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    widened = (0.18 * c.maxilla + 0.07 * max(c.impaction, 0)) * (0.5 if c.covariates.cinch else 1.0)
    amount = widened + rng.normal(0, 0.25)
    aside = amount * (site.shape("wing_left") - site.shape("wing_right"))
    return aside[:, None] * [1.0, 0, 0]


def paranasal(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    return _normal(site, _both("paranasal", 0.08 * c.maxilla, 0.3, rng))


GAINS = {"upper_lip": 0.12, "lower_lip": 0.12, "paranasal": 0.12, "chin": 0.08, "cheek": 0.05}


def gain(site: Site, displacement: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Change (n, 3) mm of a displacement (n, 3) mm by the patient's own gain in each region, whole at its middle."""
    total = np.zeros(len(site.points))
    for region, spread in GAINS.items():
        deviation = rng.normal(0, spread)
        names = [region] if region in site.regions else [f"{region}_{side}" for side in SIDES]
        total += deviation * MEAN_OF_HALF * np.max([site.shape(name) for name in names], axis=0)
    return total[:, None] * displacement


def swelling(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    left = max(39.54 - 13.14 * np.log(c.covariates.months), 0) / SWELLING_AT_6
    level = np.exp(rng.normal(-0.125, 0.5))  # mean 1
    sides = {side: left * level * np.exp(rng.normal(-0.02, 0.2)) for side in SIDES}
    amounts = {"upper_lip": 0.2 * left * level, "lower_lip": 0.2 * left * level, "submental": 0.35 * left * level}
    for side, amount in sides.items():
        amounts |= {f"cheek_{side}": 0.35 * amount, f"jaw_{side}": 0.45 * amount}
    return _normal(site, amounts)


def masseter_loss(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    more = 1 + 0.2 * c.covariates.mass
    sides = _both("jaw", -0.4 * more, 0.7, rng) | _both("cheek", -0.2 * more, 0.4, rng)
    return _normal(site, sides | {"submental": -0.3 * more + rng.normal(0, 0.6)})


def individual(site: Site, c: Circumstances, rng: np.random.Generator) -> np.ndarray:
    low, high = site.landmarks["subnasale"][2], site.landmarks["nasion"][2]
    below = np.clip((high - site.points[:, 2]) / (high - low), 0, 1)  # nothing above the nasion
    lips = np.clip(site.shape("upper_lip") + site.shape("lower_lip"), 0, 1)
    level = np.exp(rng.normal(-(INDIVIDUAL_SPREAD**2) / 2, INDIVIDUAL_SPREAD))
    amount = (
        level
        * (INDIVIDUAL + (INDIVIDUAL_LIPS - INDIVIDUAL) * lips)
        * below
        * smooth_noise(site.points, rng, INDIVIDUAL_LENGTH)
    )
    return amount[:, None] * site.outward


# Changes of the tissue by name, in the order in which they stand in the configuration.
CHANGES: dict[str, Callable] = {
    "lower_lip": lower_lip,
    "chin_pad": chin_pad,
    "upper_lip": upper_lip,
    "lip_length": lip_length,
    "alar_width": alar_width,
    "paranasal": paranasal,
    "gain": gain,
    "swelling": swelling,
    "masseter_loss": masseter_loss,
    "individual": individual,
}


def expression(site: Site, rng: np.random.Generator) -> np.ndarray:
    """Another expression at the scan, (n, 3) mm."""
    amounts = {"upper_lip": rng.normal(0, 0.3), "lower_lip": rng.normal(0, 0.4)}
    return _normal(site, amounts | _both("cheek", 0.0, 0.15, rng))
