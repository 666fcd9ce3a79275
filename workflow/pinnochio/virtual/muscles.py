"""Muscles of a virtual head: where they run, as strands between bones, mouth corner and skin."""

import numpy as np

from pinnochio.virtual.implicit import Field, Shape, ellipsoid, tube
from pinnochio.virtual.skeleton import SIDES, Skeleton

MUSCLES = ("masseter", "temporalis", "medial_pterygoid", "buccinator", "orbicularis_oris", "mentalis", "zygomaticus",
           "levator", "depressor", "floor_of_mouth")  # fmt: skip


def muscle_shapes(s: Skeleton, points: dict[str, np.ndarray], line: np.ndarray) -> dict[str, list[Shape]]:
    """Shapes of every muscle of :data:`MUSCLES`, both sides."""
    chin = s.pogonion
    shapes: dict[str, list[Shape]] = {name: [] for name in MUSCLES}
    shapes["orbicularis_oris"] = _mouth_ring(points, line)
    shapes["mentalis"] = [ellipsoid(chin + [0, -3, 10], [13, 6, 13])]
    shapes["floor_of_mouth"] = [ellipsoid([0.6 * chin[0], -46, s.lower_edge(-60.0) - 20], [32 * s.wide, 36, 9])]
    for side in SIDES:
        for name, strands in _one_side(s, line, side).items():
            shapes[name] += strands
    return shapes


def _mouth_ring(points: dict[str, np.ndarray], line: np.ndarray) -> list[Shape]:
    """Orbicularis oris: a band in each lip that tapers to the corners."""
    share = np.linspace(-1, 1, len(line))
    bands = []
    for lip, up in (("labrale_superius", 1.0), ("labrale_inferius", -1.0)):
        depth = (points[lip][1] + 6.5 - line[len(line) // 2, 1]) * (1 - share**2) + 6.5 * share**2
        bands.append(tube(line + np.stack([0 * share, depth, up * 9.5 * (1 - 0.75 * share**2)], 1), 4.5))
    return bands


def _one_side(s: Skeleton, line: np.ndarray, side: float) -> dict[str, list[Shape]]:
    """Muscles of the left (1) or right (-1) side by name."""
    w, d = s.wide, s.deep
    go, chin = s.gonion_of(side), s.pogonion
    corner = line[-1 if side > 0 else 0] + [side * 3, 8, 0]
    low = s.menton[2]

    def at(x, y, z):
        return np.array([side * x, y, z])

    angle = go + [side * 3, -10, 8]
    pillar = at(20 * w, s.a_point[1] + 4, s.spine[2] + 18)
    coronoid = at(47 * w, -42 * d, -14)
    cheek = at(38 * w, s.molar_y + 8, corner[2] + 2)
    middle = 0.5 * (corner + cheek) + at(5, 0, 0)
    return {
        "masseter": [
            *(
                tube([at(57 * w, y - 38 * d, -6), at(54 * w, y - 28, -30), angle + [0, y, 0]], [8, 9.5, 8])
                for y in (-6, 5)
            ),
            tube([at(54 * w, -42 * d, -38), at(41 * w, -56 * d, -46)], 5.0),  # anterior border
        ],
        "temporalis": [
            tube([at(53 * w, y, 34), at(52 * w, 0.4 * y - 25 * d, 6), coronoid], [9, 8, 7]) for y in (-44, -27)
        ],
        "medial_pterygoid": [
            ellipsoid(at(37 * w, go[1] - 14, -42), [8, 20, 28]),
            tube([at(37 * w, go[1] - 6, go[2] - 1), at(30, -32, low + 16)], 8.0),  # sling below the angle
        ],
        "buccinator": [
            tube([corner + [0, 2, 0.4 * z], middle + [0, 0, 0.8 * z], cheek + [0, 0, z]], 7.0) for z in (-11, 0, 11)
        ],
        "zygomaticus": [tube([at(44 * w, -66 * d, -10), corner], [5, 4.5])],
        "levator": [tube([pillar, corner + at(-8, -3, 8)], [4, 4.5])],
        "depressor": [tube([corner, at(abs(corner[0]) * 1.05, chin[1] + 18, low + 12)], [4.5, 5.5])],
        "floor_of_mouth": [tube([s.menton + at(8, 6, 4), at(26, -40, low + 14), at(34, -8, low + 10)], [6, 9, 10])],
    }


def muscle_region(s: Skeleton, points: dict[str, np.ndarray], line: np.ndarray, axes) -> np.ndarray:
    """Where muscle may be, bool on the grid; skin, bone and air are for the caller to keep."""
    field = Field(axes, reach=4.0)
    for shapes in muscle_shapes(s, points, line).values():
        field.union(*shapes, k=3)
    return field.values < 0
