"""Skin of a virtual head: bone plus tissue thickness, filled, sculpted, with nose, lips and lids."""

import numpy as np

from pinnochio.virtual.implicit import Field, Shape, ellipsoid, smooth_minimum, tube, wall
from pinnochio.virtual.skeleton import SIDES, Skeleton


def profile(s: Skeleton) -> dict[str, np.ndarray]:
    """Soft-tissue points that the sculpture is built on: bone point plus thickness of the table."""
    p = s.p
    upper, lower = s.upper_incisor, s.lower_incisor
    subnasale = np.array([0, s.a_point[1] - p.subnasale - 1.5, s.spine[2] - 1.0])
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
        "mentolabial": np.array([0.8 * lower[0], lower[1] + 3.5 - p.mentolabial, stomion[2] - 17.5]),
        "pogonion_soft": chin,
        "menton_soft": s.menton - [0, 0, p.menton],
    }


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


def skin(s: Skeleton, cranium: Field, cheeks: Field, jaw: Field) -> tuple[Field, dict[str, np.ndarray]]:
    """Field of the outer skin and the soft-tissue points of :func:`profile`."""
    p, w, d, t = s.p, s.wide, s.deep, s.tall
    points = profile(s)
    field = Field(cranium.axes, reach=8.0)
    field.values = cheeks.values - np.float32(p.zygoma - 1.5)  # the cheek's fat adds the rest
    field.values = smooth_minimum(field.values, jaw.values - np.float32(p.menton), 8)
    field.union(ellipsoid([0, 3, 52 * t], [65 * w + 4, 3 + 94 * d + p.glabella, 83 * t]), k=14)
    for z in (cranium, jaw):  # nowhere thinner than this, whatever the sculpture does
        field.values = smooth_minimum(field.values, z.values - np.float32(4), 4)
    sub, chin = points["subnasale"], points["pogonion_soft"]
    up_lip, low_lip = points["labrale_superius"], points["labrale_inferius"]
    dev = p.chin_deviation
    middle = sub[1] + 9.5
    field.union(ellipsoid([0, middle + 60, -14 * t], [61 * w, 60, 56 * t]), k=10)
    mouth_y = 0.5 * (up_lip[1] + low_lip[1]) + 9.0
    field.union(ellipsoid([0.5 * dev, mouth_y + 56, points["stomion"][2] - 2], [51 * w, 56, 40 * t]), k=12)
    top, bottom = points["stomion"][2], points["mentolabial"][2]
    front = s.arch_upper[:, 1].min() - 0.5 * (up_lip[1] + sub[1]) - 3.6
    field.union(wall(s.arch_upper[::2], front, top - 4, s.spine[2] + 4, rounding=8), k=8)
    front = s.arch_lower[:, 1].min() - points["mentolabial"][1] + 0.6
    field.union(wall(s.arch_lower[::2], front, bottom - 4, top + 3, rounding=8), k=8)
    field.union(ellipsoid([dev, chin[1] + 14, chin[2] + 1], [19 * w, 14, 13]), k=9)
    under = [0.7 * dev, -40, s.menton[2] + 18]
    field.union(ellipsoid(under, [36 * w, -chin[1] - 42, 22]), k=10)
    field.union(tube([[0, 8, -50], [0, 14, -90], [0, 19, -160]], [56 * w, 56 * w, 58 * w]), k=22)
    for side in SIDES:
        go = s.gonion_of(side)
        masseter = [0.5 * (go[0] + side * 50 * w) + side * (p.masseter - 16), go[1] - 4, -28 * t]
        field.union(ellipsoid(masseter, [14, 30, 44 * t]), k=16)
        field.union(ellipsoid([side * 52 * w, -34 * d, 14 * t], [14, 42, 40 * t]), k=16)
        cheek = p.cheek_fullness
        field.union(ellipsoid([side * (38 * w + 0.4 * cheek), -54 * d, -35 * t], [22 + cheek, 25 + cheek, 29]), k=12)
        field.union(ellipsoid([side * 40 * w, -64 * d - 0.3 * cheek, -9 * t], [17, 17, 14]), k=10)
        field.union(ellipsoid([side * 22 * w, -73.5 * d, -4 * t], [14, 14, 18]), k=12)
    _eyes(field, s)
    _nose(field, s, points)
    _mouth(field, s, points)
    rng = np.random.default_rng(p.relief_seed)
    for _ in range(36):  # irregular relief: no face is a mirror image of itself
        x, z = rng.uniform(-60, 60), rng.uniform(-90, 45)
        y = -100 * np.sqrt(max(1 - (x / 75) ** 2, 0.05))
        field.brush([[x, y, z]], p.skin_asymmetry * rng.normal(), rng.uniform(12, 22))
    return field, points


def _eyes(field: Field, s: Skeleton) -> None:
    d, t = s.deep, s.tall
    brow = s.p.brow_prominence
    for side in SIDES:
        eye = np.array([side * s.p.eye_spacing / 2, -75.0 * d, 14 * t])
        field.brush([eye + [-side * 11, -15, 3], eye + [side * 4, -12, 3]], -2.0, 8)
        field.brush(
            [eye + [-side * 14, -20, 24], eye + [side * 8, -16, 25], eye + [side * 17, -4, 20]], 0.4 + 0.6 * brow, 9
        )
        field.union(ellipsoid(eye + [0, -2.5, 12], [16, 14, 9]), k=8)
        field.union(ellipsoid(eye, [15.0, 14.5, 13.0]), k=5)
        lid = np.array([[-14, 1.5, -2.5], [-8, -11, -2.2], [0, -14, -3.2], [8, -12, -2.4], [14, -4, -0.5]]) * [
            side,
            1,
            1,
        ]
        field.brush(eye + lid, -1.6, 1.6)
        crease = np.array([[-11, -8, 6], [-4, -12, 8.5], [5, -11, 8.5], [13, -5, 5]]) * [side, 1, 1]
        field.brush(eye + crease, -1.0, 2.2)
        bag = np.array([[-12, -7, -10], [-3, -12, -12.5], [7, -10, -12]]) * [side, 1, 1]
        field.brush(eye + bag, -0.4, 4)


def _nose(field: Field, s: Skeleton, points: dict[str, np.ndarray]) -> None:
    p = s.p
    sub, tip, root = points["subnasale"], points["pronasale"], points["nasion"]
    half = p.nose_width / 2
    hump = 0.5 * (root + tip) + [0, 3.8 - p.dorsal_hump, 1]
    start, end = root + [0, 4.8, 0], tip + [0, 7.5, 1.0]
    field.union(tube([start, hump + [0, 1.5, 0], end], [4.6, 4.8, 6.0]), k=5)
    field.union(tube([root + [0, 11, 0], 0.5 * (root + sub) + [0, 1, 4], sub + [0, 0, 8]], [5, 7.5, 9]), k=4)
    field.union(ellipsoid(tip + [0, 8.0, 0.5], [8.2, 8.0, 7.4]), k=5)
    base = sub[2] + 4.5
    for side in SIDES:
        wing = np.array([side * (half - 5.2), sub[1] - 2.0, base + 2.2])
        flank = [[side * 4, root[1] + 9, 18], [side * 0.5 * half, 0.5 * (root[1] + sub[1]) + 6, 0.5 * (18 + base)]]
        field.union(tube([*flank, [side * (half - 9), sub[1] + 2, base + 6]], [3.5, 5.5, 7.0]), k=8)
        field.union(ellipsoid(wing, [5.4, 8.5, 6.6]), k=3.5)
        field.union(tube([wing + [-side * 1, -5, -0.5], tip + [side * 3.5, 7.5, -1.5]], [4.0, 5.0]), k=3)
    field.union(tube([sub + [0, 4, 0.5], tip + [0, 9.5, -3.5]], [3.6, 3.2]), k=3)
    for side in SIDES:
        inlet = np.array([side * (0.40 * half), 0.6 * sub[1] + 0.4 * tip[1], base - 2.5])
        field.subtract(ellipsoid(inlet + [0, 2.0, 0], [2.9, 5.4, 5.0], tilt=12), k=1.5)
        field.brush(
            [[side * (half - 1.5), sub[1] + 2, base + 7], [side * (half + 0.5), sub[1] + 3, base - 1]], -1.2, 2.6
        )


def _mouth(field: Field, s: Skeleton, points: dict[str, np.ndarray]) -> None:
    p = s.p
    line = mouth_line(s, points)
    up, low, sub = points["labrale_superius"], points["labrale_inferius"], points["subnasale"]
    full = p.lip_fullness
    field.union(lip(line, up, 5.2 * full, 1.0), k=3)
    field.union(lip(line, low, 5.8 * full, -1.0), k=3)
    mid = points["stomion"]
    field.brush([sub + [0, 0.5, -5], up + [0, 0.5, 3.5]], -1.1, 2.6)
    for side in SIDES:
        field.brush([sub + [side * 4.5, 1, -5], up + [side * 4.2, 1, 3.5]], 0.5, 2.2)
        corner = line[-1 if side > 0 else 0]
        field.brush([corner + [side * 1.5, 1, 0]], -1.8, 3.0)
        fold = [
            [side * (p.nose_width / 2 + 3), sub[1] + 7, sub[2] + 7],
            corner + [side * 8, 5, 9],
            corner + [side * 8, 6, -4],
        ]
        field.brush(fold, -1.5, 4.0)
    fold = points["mentolabial"]
    field.brush([fold + [-14, 5, 0], fold, fold + [14, 5, 0]], -1.6, 5.5)
    field.brush([[mid[0], low[1] + 4, low[2] - 6]], -0.4, 4)
