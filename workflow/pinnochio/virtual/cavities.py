"""Air inside a virtual head: mouth and throat, the gap between the lips, and the nasal airway."""

import numpy as np

from pinnochio.virtual.implicit import Field, Shape, ellipsoid, tube
from pinnochio.virtual.skeleton import SIDES, Skeleton

SLIT = 1.4  # mm between the lips [I]
WALL = 8.0  # mm of tissue at least between the skin of a scanned face and mouth or throat [I]
MUCOSA = 1.4  # mm of lining between the nasal airway and its bone [I]


def _interior(line: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Inside of an arch, open to the back, in the axial plane."""
    order = np.argsort(line[:, 0])
    front = np.interp(x[:, :, 0], line[order, 0], line[order, 1], left=np.inf, right=np.inf)
    return (y[:, :, 0] > front)[:, :, None]


def oral(s: Skeleton, x, y, z) -> np.ndarray:
    """Mouth and throat: air behind the dental arches and between the rami."""
    scale = 1 + 3.0 / np.abs(s.arch_upper[:, 0]).max()
    between = 0.5 * (s.upper_edge(y) + s.lower_edge(y))
    rear = (y > s.molar_y) & (np.abs(x) < np.where(z > between, 37, 27) * s.wide) & (z < -8) & (z > between - 24)
    top = _interior(s.arch_upper * [scale, 1] + [0, 2.0], x, y) & (z > between) & (z < s.spine[2] + 1)
    low = _interior(s.arch_lower * [scale, 1] + [0, 2.0], x, y) & (z <= between) & (z > between - 20)
    front = (top | low) & (y <= s.molar_y)
    throat = ((x / (38 * s.wide)) ** 2 + ((y - 2) / 35) ** 2 < 1) & (z < -8)
    return front | rear | throat


def slit(s: Skeleton, line: np.ndarray, x, y, z, spacing: float) -> np.ndarray:
    """Gap between the lips along their line (m, 3), from the skin to the teeth."""
    height = np.interp(x, line[:, 0], line[:, 2]).astype(np.float32)
    teeth = np.maximum(
        *(np.interp(x, a[:, 0], a[:, 1], left=np.inf, right=np.inf) for a in (s.arch_upper, s.arch_lower))
    )
    span = (x > line[0, 0]) & (x < line[-1, 0])
    return span & (np.abs(z - height) < max(SLIT, 1.3 * spacing) / 2) & (y < teeth + 4)


def behind_lips(line: np.ndarray, x, y, z) -> np.ndarray:
    """Where the inner sides of a face's lips enclose air: behind their line (m, 3), within 9 mm of its height."""
    height = np.interp(x, line[:, 0], line[:, 2])
    front = np.interp(x, line[:, 0], line[:, 1], left=np.inf, right=np.inf)
    return (np.abs(z - height) < 9) & (y > front + 0.5)


def airway(s: Skeleton, nostrils: np.ndarray, margin: float = 0.0) -> list[Shape]:
    """Both nasal passages, from the upper ends of the nostrils (2, 3) to the throat; `margin` mm wider all round."""
    shapes, floor, ahead = [], s.spine[2], s.spine[1]
    for side, top in zip(SIDES, nostrils, strict=True):
        cavity = np.array([side * 6.4 * s.wide, ahead + 12, 0.62 * floor])
        shapes.append(ellipsoid(cavity, np.array([3.8 * s.wide, 14.0, 0.3 * -floor]) + margin))
        shapes.append(tube([top - [0, 0, 3], top + [0, 2, 0], cavity - [0, 6, 0]], 3.5 + margin))
        back = [cavity + [0, 8, 0], [side * 6.5, -60, 0.72 * floor], [side * 7, -44, -18], [side * 7, -30, -22]]
        shapes.append(tube(back, 3.8 + margin))
    return shapes


def air_in(shapes: list[Shape], axes) -> np.ndarray:
    """Grid points inside any of the shapes."""
    return Field(axes, reach=1.0).union(*shapes).values < 0
