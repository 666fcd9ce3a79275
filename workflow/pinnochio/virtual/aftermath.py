"""What surgery does to a face beyond moving bone, as displacement fields: lips and nose, swelling, expression."""

import json
import os
from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.triangles import vertex_normals

LIP_THICKNESS = 10.0  # mm from bone at which tissue follows fully; none at the bone [I]
# Size in mm and SD of the reach in mm, at a multiple of one.
UPPER_LIP, LOWER_LIP, WING, REACH = 0.8, 1.0, 1.0, 8.0
SWELLING_REACH, SWELLING_SPREAD = 20.0, 0.5  # mm; SD over patients and sides relative to the mean [I]
CORNER_REACH = 12.0  # mm [I]
SMILE = np.array([0.75, 0.25, 0.6])  # direction of the left corner: out, back and up [I]


def read_landmarks(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Landmarks (3,) mm by name."""
    with open(path, encoding="utf-8") as file:
        return {name: np.array(place) for name, place in json.load(file).items()}


def looseness(points: np.ndarray, bone_points: np.ndarray) -> np.ndarray:
    """How freely tissue may move against the bone, (n,): 0 at the bone, 1 at the thickness of a lip [I]."""
    return np.clip(cKDTree(bone_points).query(points)[0] / LIP_THICKNESS, 0, 1)


def bump(points: np.ndarray, centre: np.ndarray, reach: float, stretch=1.0) -> np.ndarray:
    """Gaussian (n,) around a centre with SD `reach` mm; `stretch` below 1 widens an axis."""
    return np.exp(-0.5 * np.sum(((points - centre) * stretch / reach) ** 2, 1))


def lip_change(points: np.ndarray, landmarks: Mapping[str, np.ndarray]) -> np.ndarray:
    """Systematic change of lips and nasal base that no rigid plan contains, (n, 3) mm.

    The upper lip flattens (a third of it down) after the vestibular incision [I]; the lower lip, no longer strained,
    curls in (half back and half up) [S: KIM16/19 name it; the size is I]; each wing of the nose moves 1 mm sideways:
    +4 mm of width in all after Le Fort I advance [S: PMC6173856], of which the mechanics already gives a part [I].
    """
    width = np.linalg.norm(landmarks["cheilion_left"] - landmarks["cheilion_right"])
    wing = np.array([0.34 * width, 4.0, 4.0])  # from subnasale
    lips = np.array([0.5, 1, 1])  # lips are wide, wings are not
    subnasale = landmarks["subnasale"]
    sites = [
        (landmarks["labrale_superius"], UPPER_LIP * np.array([0, 1, -1 / 3]), lips),
        (landmarks["labrale_inferius"], LOWER_LIP * np.array([0, 0.5, 0.5]), lips),
        (subnasale + wing, WING * np.array([1.0, 0, 0]), 1.0),
        (subnasale + wing * [-1, 1, 1], WING * np.array([-1.0, 0, 0]), 1.0),
    ]
    return sum(bump(points, centre, REACH, stretch)[:, None] * push for centre, push, stretch in sites)


def swelling(
    points: np.ndarray,
    skin: tuple[np.ndarray, np.ndarray],
    landmarks: Mapping[str, np.ndarray],
    mean: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Residual swelling outward over the cheek and jaw angle of each side, (n, 3) mm.

    skin: points and outward faces; mean (mm) at the centre of the bump over patients; sides differ.
    """
    normals, tree = vertex_normals(*skin), cKDTree(skin[0])
    outward = normals[tree.query(points)[1]]
    size = np.zeros(len(points))
    for side in ("left", "right"):
        own = mean * max(rng.normal(1, SWELLING_SPREAD), 0)
        between = 0.5 * (landmarks[f"cheilion_{side}"] + landmarks[f"tragus_{side}"])
        centre = skin[0][tree.query(between + [0, 0, -12])[1]]  # over the body of the mandible
        size += own * bump(points, centre, SWELLING_REACH)
    return size[:, None] * outward


def expression(
    points: np.ndarray, landmarks: Mapping[str, np.ndarray], spread: float, rng: np.random.Generator
) -> np.ndarray:
    """Another expression of the mouth at the scan, (n, 3) mm: corners up or down with SD `spread` mm, a third of it
    different on both sides."""
    common = rng.normal()
    field = np.zeros((len(points), 3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        push = spread * (common + 0.33 * rng.normal()) / np.hypot(1, 0.33) * SMILE * [sign, 1, 1]
        field += bump(points, landmarks[f"cheilion_{side}"], CORNER_REACH)[:, None] * push / np.linalg.norm(SMILE)
    return field
