"""Where the thickness of the soft tissue is taken: rays from the skin to the bone at the landmarks."""

from typing import NamedTuple

import numpy as np

from pinnochio.virtual.skeleton import SIDES, Skeleton

REACH = 45.0  # mm of a ray on either side of its target
STEP = 0.25  # mm along a ray


class Ray(NamedTuple):
    """Along which thickness is taken: from the skin `inward` (3,) unit to the bone about `target` (3,) mm."""

    target: np.ndarray
    inward: np.ndarray

    def points(self, step: float) -> np.ndarray:
        """Points (n, 3) mm every `step` mm along the ray, from well outside the head to well behind the target."""
        return self.target + np.arange(-REACH, REACH, step)[:, None] * self.inward


# Width (mm) of the correction that brings a landmark's thickness to its sampled number.
SITES = {"glabella": 9, "nasion": 7, "zygoma": 11, "masseter": 18, "cheek": 15, "menton": 9, "pogonion": 9,
         "mentolabial": 6, "subnasale": 5, "mid_philtrum": 5, "labrale_inferius": 6, "labrale_superius": 6}  # fmt: skip


def sites(s: Skeleton, points: dict[str, np.ndarray]) -> dict[str, list[Ray]]:
    """Where and in which direction the thickness of each landmark is measured."""
    w, d, t = s.wide, s.deep, s.tall
    back, up = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
    philtrum = 0.5 * (points["subnasale"] + points["labrale_superius"])
    lower = s.lower_incisor - [0, 0, 3.0]  # the labial face below the edge; the lip may stand higher in an open bite
    ahead = lower - points["labrale_inferius"]
    rays = {
        "glabella": [Ray(points["glabella"], back)],
        "nasion": [Ray(points["nasion"], back)],
        "subnasale": [Ray(points["subnasale"] - [0, 0, 1], back)],
        "mid_philtrum": [Ray(philtrum, back)],
        "labrale_superius": [Ray(points["labrale_superius"], back)],
        "labrale_inferius": [Ray(lower, ahead / np.linalg.norm(ahead))],
        "mentolabial": [Ray(points["mentolabial"], back)],
        "pogonion": [Ray(s.pogonion, back)],
        "menton": [Ray(s.menton, up)],
    }
    for name in ("zygoma", "masseter", "cheek"):
        rays[name] = []
    for side in SIDES:
        medial, go = np.array([-side, 0, 0]), s.gonion_of(side)
        oblique = np.array([-0.7 * side, 0.65, 0.3]) / np.linalg.norm([0.7, 0.65, 0.3])
        ramus = np.array([go[0], 0.5 * (s.molar_y + 3 + go[1]), 0.5 * (go[2] + s.condyle[2])])
        rays["zygoma"].append(Ray(np.array([side * 46 * w, -64 * d, -8 * t]), oblique))
        rays["masseter"].append(Ray(ramus, medial))
        molar = np.array([side * 20 * w, s.molar_y - 18 * d, s.upper_edge(s.molar_y) + 5])
        rays["cheek"].append(Ray(molar, np.array([-0.8 * side, 0.6, 0])))
    return rays
