"""A face of blocks, a cube of tetrahedra and a dome: shapes whose labels, cells and edges are known."""

import numpy as np

from pinnochio.mechanics.problems import box
from pinnochio.meshing.mesh import TetMesh
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL

SEGMENTS = ("lefort1", "mandible_distal", "proximal_left")
LEFORT, DISTAL, PROXIMAL = 11, 12, 13
ORIGIN = np.array([5.0, -60.0, -20.0])


def block_face():
    """Tissue 14 mm thick in front of a wall of bones: y < 8 air, 8..21 tissue, 22..39 bone.

    From the top: cranium, maxilla, 6 mm of mouth, mandible with a proximal segment beside it (x > 40). A slit of 1 mm
    joins mouth and air. Muscle is the hind half of the tissue in the upper half. Cut at both sides, top and bottom.
    """
    labels = np.full((56, 40, 80), AIR, np.uint8)
    labels[:, 8:22] = SUPERFICIAL
    labels[:, 15:22, 40:] = MUSCLE
    labels[:, 22:, 56:] = CRANIUM
    labels[:, 22:, 38:56] = LEFORT
    labels[:, 22:, :32] = DISTAL
    labels[40:, 22:, :32] = PROXIMAL
    labels[8:48, 8:22, 34] = AIR
    return labels, np.ones(3), ORIGIN


def kuhn_cube(n=2):
    """Unit cube of n x n x n boxes, six tetrahedra each."""
    points, cells = box((1, 1, 1), (n, n, n))
    return TetMesh(points, cells, np.ones(len(cells), np.int8))


def dome(count=41, radius=80.0, mouth=False):
    """Front half of a sphere as a triangle grid, outward normals towards -y; `mouth` cuts a slit into it."""
    u = np.linspace(-1.3, 1.3, count)
    a, b = (grid.ravel() for grid in np.meshgrid(u, 0.8 * u, indexing="ij"))
    points = radius * np.stack([np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b), np.sin(b)], 1)
    i = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + count, i + count + 1], 1), np.stack([i, i + count + 1, i + 1], 1)])
    if mouth:
        centre = points[faces].mean(1)
        faces = faces[~((np.abs(centre[:, 0]) < 20) & (np.abs(centre[:, 2] + 20) < 3))]
    return points, faces
