"""A tetrahedral mesh with a tissue per cell."""

import os
from dataclasses import dataclass

import meshio
import numpy as np

from pinnochio.errors import InputError
from pinnochio.files import check_seal, replacing, seal
from pinnochio.geometry.mesh_topology import EDGES, boundary_faces


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
            seal(temporary)

    @classmethod
    def read(cls, path: str | os.PathLike) -> "TetMesh":
        """Read what :meth:`write` wrote."""
        try:
            check_seal(path)
            mesh = meshio.read(path)
            cells = mesh.cells_dict["tetra"].astype(np.int32)
            made = cls(mesh.points, cells, mesh.cell_data["tissue"][0])
            if not np.isfinite(made.points).all() or not (cells.min() >= 0 and cells.max() < len(made.points)):
                raise ValueError("its cells and points do not fit")
        except (Exception, SystemExit) as error:  # meshio ends the process by itself
            problem = f"it cannot be read ({error})"
            raise InputError("-", path, problem, "delete it; the same command makes it again") from error
        return made


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
