"""Skin of a virtual head: bone plus tissue thickness, filled, sculpted, with nose, lips and lids."""

from typing import NamedTuple

import numpy as np

from pinnochio.virtual.implicit import Field, Shape, ellipsoid, smooth_minimum, tube, wall
from pinnochio.virtual.parameters import TABLE, HeadParameters
from pinnochio.virtual.skeleton import SIDES, Skeleton


def profile(s: Skeleton) -> dict[str, np.ndarray]:
    """Soft-tissue points that the sculpture is built on: bone point plus thickness of the table."""
    p = s.p
    upper, lower = s.upper_incisor, s.lower_incisor
    subnasale = np.array([0, s.a_point[1] - p.subnasale - 0.4, s.spine[2] - 1.0])
    stomion = np.array([0.35 * lower[0], 0, 0.75 * upper[2] + 0.25 * (lower[2] + 2) + 2.2])
    upper_lip = np.array([0.2 * lower[0], upper[1] + 1.5 - p.labrale_superius, stomion[2] + 5.4 * p.lip_fullness])
    # The lower lip leans on whichever incisor is ahead; far behind the upper ones it stays half way.
    support = lower[1] - 0.35 * max(lower[1] - upper[1] - 3, 0)
    lower_lip = np.array([0.6 * lower[0], support + 1.5 - p.labrale_inferius, stomion[2] - 5.8 * p.lip_fullness])
    stomion[1] = max(upper_lip[1], lower_lip[1]) + 4
    chin = s.pogonion - [0, p.pogonion, -1.0]
    tip = subnasale + [0, -p.nose_length, 11.5 * s.tall + p.nose_rotation]
    return {
        "glabella": s.nasion + [0, -2.5 - p.glabella - p.brow_prominence, 11 * s.tall],
        "nasion": s.nasion - [0, p.nasion, 0],
        "pronasale": tip,
        "subnasale": subnasale,
        "labrale_superius": upper_lip,
        "stomion": stomion,
        "labrale_inferius": lower_lip,
        "mentolabial": np.array([0.8 * lower[0], lower[1] + 5.2 - p.mentolabial, stomion[2] - 17.5]),
        "pogonion_soft": chin,
        "menton_soft": s.menton - [0, 0, p.menton],
    }


REACH = 45.0  # mm of a ray on either side of its target
STEP, ROUNDS = 0.25, 3  # mm along a ray; neighbouring landmarks disturb each other, so each is corrected again


class Ray(NamedTuple):
    """Along which thickness is taken: from the skin `inward` (3,) unit to the bone about `target` (3,) mm."""

    target: np.ndarray
    inward: np.ndarray

    def points(self, step: float) -> np.ndarray:
        """Points (n, 3) mm every `step` mm along the ray, from well outside the head to well behind the target."""
        return self.target + np.arange(-REACH, REACH, step)[:, None] * self.inward


# Width (mm) of the correction that brings a landmark's thickness to its sampled number; the lips come last.
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


def fit_thickness(field: Field, bone: np.ndarray, rays: dict[str, list[Ray]], p: HeadParameters) -> None:
    """Raise or dent the skin until its distance from the bone (field values) is the sampled one at every landmark."""
    for name in [*SITES] * ROUNDS:
        for ray in rays[name]:
            at = ray.points(STEP)
            first = [np.flatnonzero(field.sample(values, at) < 0) for values in (field.values, bone)]
            if all(map(len, first)):
                excess = STEP * (first[1][0] - first[0][0]) - getattr(p, name)
                field.brush([at[first[0][0]]], -excess, SITES[name])


def mouth_line(s: Skeleton, points: dict[str, np.ndarray], count: int = 13) -> np.ndarray:
    """Line between the lips, right to left commissure, (count, 3) mm, at the depth of the lips' front."""
    half = s.p.mouth_width / 2
    x = np.linspace(-1, 1, count)
    mid = points["stomion"]
    back = 12.5 * (s.p.mouth_width / 50) * np.abs(x) ** 2.2
    return np.stack([mid[0] * (1 - 0.3 * x**2) + half * x, mid[1] + back, mid[2] - 1.6 * x**2 + 0.5 * np.cos(3 * x)], 1)


def lip(line: np.ndarray, centre: np.ndarray, radius: float, up: float) -> Shape:
    """Vermilion roll along the mouth line; `centre` is the most forward point of the lip, `up` +1 upper, -1 lower."""
    share = np.linspace(-1, 1, len(line))
    radii = radius * (0.22 + 0.78 * np.cos(share * np.pi / 2) ** 0.8)
    points = line.copy()
    points[:, 1] += (centre[1] - line[len(line) // 2, 1]) * (1 - share**2) + radii
    points[:, 2] += up * radii * 0.92
    if up > 0:  # Cupid's bow
        points[:, 2] += 0.9 * np.exp(-(((np.abs(share) - 0.28) / 0.16) ** 2)) - 0.3 * np.exp(-((share / 0.12) ** 2))
    return tube(points, radii)


def skin(s: Skeleton, points: dict[str, np.ndarray], cranium: Field, cheeks: Field, jaw: Field) -> Field:
    """Field of the outer skin through the soft-tissue points of :func:`profile`, as thick as sampled at the sites."""
    p, w, d, t = s.p, s.wide, s.deep, s.tall
    field = Field(cranium.axes, reach=8.0)
    field.values = cheeks.values - np.float32(p.zygoma - 2.5)  # the cheek's fat adds the rest
    field.values = smooth_minimum(field.values, jaw.values - np.float32(p.menton - 1), 8)
    field.union(ellipsoid([0, 3, 52 * t], [65 * w + 4, 3 + 93 * d + p.glabella, 83 * t]), k=14)
    for z in (cranium, jaw):  # nowhere thinner than this, whatever the sculpture does
        field.values = smooth_minimum(field.values, z.values - np.float32(4), 4)
    sub, chin = points["subnasale"], points["pogonion_soft"]
    up_lip, low_lip = points["labrale_superius"], points["labrale_inferius"]
    dev, full = p.chin_deviation, 0.6 * (p.cheek - TABLE["cheek"].mean)
    middle = sub[1] + 9.0
    field.union(ellipsoid([0, middle + 58, -14 * t], [57 * w, 58, 54 * t]), k=10)
    mouth_y = 0.5 * (up_lip[1] + low_lip[1]) + 9.0
    field.union(ellipsoid([0.5 * dev, mouth_y + 54, points["stomion"][2] - 2], [46 * w, 54, 38 * t]), k=12)
    top, bottom = points["stomion"][2], points["mentolabial"][2]
    front = s.arch_upper[:, 1].min() - 0.5 * (up_lip[1] + sub[1]) - 3.0
    field.union(wall(s.arch_upper[::2], front, top + 4, s.spine[2] + 4, rounding=8), k=6)
    front = s.arch_lower[:, 1].min() - points["mentolabial"][1] + 2.0
    field.union(wall(s.arch_lower[::2], front, bottom - 4, top - 6, rounding=8), k=6)
    field.union(ellipsoid([dev, chin[1] + 14, chin[2] + 1], [0.5 * p.chin_width + 5, 14, 13]), k=9)
    neck = 0.5 * p.neck_width
    under = [0.7 * dev, -40, s.menton[2] + 17]
    field.union(ellipsoid(under, [0.62 * neck, -chin[1] - 44, 21]), k=10)
    field.union(tube([[0, neck - 44, -46], [0, neck - 41, -90], [0, neck - 37, -160]], [neck, neck, neck + 3]), k=20)
    for side in SIDES:
        go = s.gonion_of(side)
        masseter = [0.5 * (go[0] + side * 50 * w) + side * (p.masseter - 14), go[1] - 4, -24 * t]
        field.union(ellipsoid(masseter, [12, 28, 34 * t]), k=16)
        field.union(ellipsoid([side * 52 * w, -34 * d, 12 * t], [13, 40, 38 * t]), k=16)
        field.union(ellipsoid([side * (36 * w + 0.4 * full), -54 * d, -36 * t], [22 + full, 25 + full, 28]), k=14)
        field.union(ellipsoid([side * 40 * w, -63 * d, -10 * t], [17, 17, 15]), k=12)
        field.union(ellipsoid([side * 22 * w, -73.0 * d, -6 * t], [14, 14, 18]), k=12)
        field.brush([[side * 34 * w, -88 * d, -13 * t]], p.malar_fullness, 13)
        field.brush([[side * 46 * w, -66 * d, -40 * t]], -0.8 + 0.5 * p.malar_fullness, 14)
    _eyes(field, s)
    _nose(field, s, points)
    _mouth(field, s, points)
    rng = np.random.default_rng(p.relief_seed)
    for _ in range(36):  # irregular relief: no face is a mirror image of itself
        x, z = rng.uniform(-60, 60), rng.uniform(-90, 45)
        y = -100 * np.sqrt(max(1 - (x / 75) ** 2, 0.05))
        field.brush([[x, y, z]], p.skin_asymmetry * rng.normal(), rng.uniform(12, 22))
    fit_thickness(field, np.minimum(cranium.values, jaw.values), sites(s, points), p)
    return field


def _eyes(field: Field, s: Skeleton) -> None:
    """Closed lids between brow and cheek."""
    d, t = s.deep, s.tall
    brow = s.p.brow_prominence
    for side in SIDES:
        flip = np.array([side, 1, 1])
        eye = np.array([side * s.p.eye_spacing / 2, -75.0 * d, 14 * t])
        field.brush([eye + [-side * 12, -15, 3], eye + [side * 4, -12, 3]], -1.5, 8)
        ridge = [eye + [-side * 15, -20, 22], eye + [side * 6, -16, 24], eye + [side * 18, -4, 19]]
        field.brush(ridge, 0.5 + 0.7 * brow, 8)
        field.union(ellipsoid(eye + [0, -2.5, 12], [16, 13, 8]), k=8)
        field.union(ellipsoid(eye + [0, 0.5, 0], [14.5, 14.0, 12.0]), k=4)
        lid = [[-15, -3, -3], [-11, -9, -3.6], [-4, -13, -4.8], [4, -13.5, -4.8], [11, -9, -3], [15.5, -3, -0.5]]
        lid = np.array(lid)
        field.brush(eye + lid * flip, -2.2, 1.5)
        field.brush(eye + (lid + [0, -0.5, 2.2])[1:-1] * flip, 0.7, 1.8)
        crease = np.array([[-12, -8, 4.5], [-5, -12, 7.5], [4, -12, 8.0], [12, -6, 5]])
        field.brush(eye + crease * flip, -1.5, 2.2)
        bag = np.array([[-13, -8, -9], [-4, -12, -12.5], [7, -10, -12]])
        field.brush(eye + bag * flip, -0.7, 3.5)


def _nose(field: Field, s: Skeleton, points: dict[str, np.ndarray]) -> None:
    p = s.p
    sub, tip, root = points["subnasale"], points["pronasale"], points["nasion"]
    half = p.nose_width / 2
    round_ = half / 16
    hump = 0.5 * (root + tip) + [0, 3.8 - p.dorsal_hump, 1]
    start, end = root + [0, 4.2, 0], tip + [0, 7.0, 1.5]
    field.union(tube([start, hump + [0, 1.5, 0], end], [4.6, 4.4 * round_, 5.4 * round_]), k=5)
    field.union(tube([root + [0, 11, 0], 0.5 * (root + sub) + [0, 1, 4], sub + [0, 0, 8]], [5, 7, 8]), k=5)
    field.union(ellipsoid(tip + [0, 7.4, 0.5], [7.4 * round_, 7.4, 6.6]), k=5)
    base = sub[2] + 4.0
    for side in SIDES:
        wing = np.array([side * (half - 5.0), sub[1] - 0.5, base + 2.6])
        flank = [[side * 4, root[1] + 9, 18], [side * 0.45 * half, 0.5 * (root[1] + sub[1]) + 6, 0.5 * (18 + base)]]
        field.union(tube([*flank, [side * (half - 9), sub[1] + 2, base + 6]], [3.5, 5.5, 6.5]), k=8)
        field.union(ellipsoid(wing, [5.2, 7.5, 6.0]), k=3)
        field.union(tube([wing + [-side * 1.5, -5, 0], tip + [side * 3.0, 7.0, 0]], [4.2, 5.0]), k=4)
    field.union(tube([sub + [0, 4, 0.5], tip + [0, 9.0, -3.0]], [3.4, 3.0]), k=3)
    for side in SIDES:
        inlet = np.array([side * (0.40 * half), 0.66 * sub[1] + 0.34 * tip[1], base - 2.0])
        field.subtract(ellipsoid(inlet + [0, 1.5, 0], [2.7, 5.2, 5.0], tilt=12), k=1.5)
        groove = [[side * (half - 2.5), sub[1] - 4, base + 10], [side * half, sub[1] + 3, base + 7],
                  [side * (half + 0.5), sub[1] + 4, base - 1]]  # fmt: skip
        field.brush(groove, -1.3, 2.4)


def _mouth(field: Field, s: Skeleton, points: dict[str, np.ndarray]) -> None:
    p = s.p
    line = mouth_line(s, points)
    up, low, sub = points["labrale_superius"], points["labrale_inferius"], points["subnasale"]
    full = p.lip_fullness
    field.union(lip(line, up, 5.5 * full, 1.0), k=2)
    field.union(lip(line, low, 6.2 * full, -1.0), k=2)
    mid = points["stomion"]
    field.brush([sub + [0, 0.5, -4], up + [0, 0.5, 4.5]], -0.9, 2.4)
    rise = np.cos(np.linspace(-1.3, 1.3, len(line)))
    for height, point in ((9.5 * full, up), (-10.5 * full, low)):  # the skin falls back at the vermilion border
        border = line + np.stack([0 * rise, (point[1] - mid[1] + 5) * rise, height * rise], 1)
        field.brush(border[1:-1], -0.9, 2.4)
    for side in SIDES:
        field.brush([sub + [side * 4.3, 1, -5], up + [side * 4.2, 1, 3.5]], 0.6, 2.0)
        corner = line[-1 if side > 0 else 0]
        field.brush([corner + [side * 1.5, 1, -0.5]], -2.0, 3.0)
        fold = [
            [side * (p.nose_width / 2 + 3), sub[1] + 7, sub[2] + 7],
            corner + [side * 8, 5, 9],
            corner + [side * 8, 6, -4],
        ]
        field.brush(fold, -1.1 - 0.4 * p.male, 4.0)
    fold = points["mentolabial"]
    field.brush([fold + [-14, 5, 0], fold, fold + [14, 5, 0]], -0.6, 4.5)
    field.brush([[mid[0], low[1] + 4, low[2] - 6]], -0.6, 4)
