"""A tetrahedral mesh with a tissue per cell."""

import os
from dataclasses import dataclass

import meshio
import numpy as np

from pinnochio.files import replacing

# Faces of a tetrahedron of positive volume, each seen counter-clockwise from outside; face i is opposite corner i.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


@dataclass(frozen=True)
class TetMesh:
    """Conforming tetrahedra: points (n, 3) mm, cells (m, 4) int32 of positive volume, tissue (m,) int8 label code."""

    points: np.ndarray
    cells: np.ndarray
    tissue: np.ndarray

    def volumes(self) -> np.ndarray:
        """Signed volume (m,) of every cell, mm3."""
        return volumes(self.points, self.cells)

    def dihedral_angles(self) -> np.ndarray:
        """The six dihedral angles (m, 6) of every cell, degrees."""
        return np.degrees(np.arccos(dihedral_cosines(self.points, self.cells)))

    def boundary_faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (f, 3) int32 that belong to one cell only, outward, and their cell (f,)."""
        faces, owner = boundary_faces(self.cells)
        return faces.astype(np.int32), owner

    def write(self, path: str | os.PathLike) -> None:
        """Write as VTU."""
        mesh = meshio.Mesh(self.points, [("tetra", self.cells)], cell_data={"tissue": [self.tissue]})
        with replacing(path) as temporary:
            mesh.write(temporary, file_format="vtu")

    @classmethod
    def read(cls, path: str | os.PathLike) -> "TetMesh":
        """Read what :meth:`write` wrote."""
        mesh = meshio.read(path)
        return cls(mesh.points, mesh.cells_dict["tetra"].astype(np.int32), mesh.cell_data["tissue"][0])


def volumes(points, cells) -> np.ndarray:
    """Signed volume of every cell, mm3."""
    a, b, c, d = np.moveaxis(points[cells], 1, 0)
    return np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) / 6


def dihedral_cosines(points, cells) -> np.ndarray:
    """Cosines (m, 6) of the dihedral angles; a flat or inverted cell has one of 1 or -1 beside it, judge its volume."""
    a, b, c, d = np.moveaxis(points[cells], 1, 0)
    ab, ac, ad = b - a, c - a, d - a
    normals = np.stack([np.cross(c - b, d - b), np.cross(ad, ac), np.cross(ab, ad), np.cross(ac, ab)], axis=1)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.where(length > 0, length, 1)
    # The edge between two corners is shared by the two faces opposite the other two corners.
    i, j = EDGES.T
    return np.clip(-np.einsum("mek,mek->me", normals[:, i], normals[:, j]), -1, 1)


def faces_of(cells) -> tuple[np.ndarray, np.ndarray]:
    """All faces (4m, 3), outward, and a key (4m,) that the two sides of a face share."""
    faces = np.asarray(cells)[:, FACES].reshape(-1, 3)
    low, middle, high = np.sort(faces, axis=1).astype(np.int64).T
    count = int(faces.max()) + 1 if len(faces) else 1
    # Two face ids fit 64 bits up to two million nodes.
    return faces, (low * count + middle) * count + high


def adjacency(cells) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of faces that are the two sides of one: indices (p,), (p,) into the 4m faces (cell = index // 4)."""
    _, key = faces_of(cells)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    return order[same], order[same + 1]


def boundary_faces(cells) -> tuple[np.ndarray, np.ndarray]:
    """Outward faces (f, 3) with one cell only, and that cell (f,)."""
    faces, _ = faces_of(cells)
    alone = np.ones(len(faces), bool)
    for side in adjacency(cells):
        alone[side] = False
    index = np.flatnonzero(alone)
    return faces[index], index // 4
