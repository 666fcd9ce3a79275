"""A tetrahedral mesh with a tissue per cell."""

import os
from dataclasses import dataclass

import meshio
import numpy as np

from pinnochio.compiled import compiled
from pinnochio.errors import damaged
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
            raise damaged(path, error) from error
        return made


def volumes(points, cells) -> np.ndarray:
    """Signed volume of every cell, mm3."""
    return _shapes(points, np.asarray(cells, np.int64), False)[0]


def dihedral_cosines(points, cells) -> np.ndarray:
    """Cosines (m, 6) of the dihedral angles; a flat or inverted cell has one of 1 or -1 beside it, judge its volume."""
    return _shapes(points, np.asarray(cells, np.int64), True)[1]


@compiled
def _shapes(points, cells, angles):
    """Volumes (m,) and, with angles, cosines (m, 6)."""
    volume, cosines = np.empty(len(cells)), np.empty((len(cells) if angles else 0, 6))
    normals = np.empty((4, 3))
    for e in range(len(cells)):
        a, b, c, d = points[cells[e, 0]], points[cells[e, 1]], points[cells[e, 2]], points[cells[e, 3]]
        volume[e] = 0.0
        for i in (0, 2, 1):
            j, k = (i + 1) % 3, (i + 2) % 3
            volume[e] += (b[i] - a[i]) * ((c[j] - a[j]) * (d[k] - a[k]) - (c[k] - a[k]) * (d[j] - a[j]))
            normals[0, i] = (c[j] - b[j]) * (d[k] - b[k]) - (c[k] - b[k]) * (d[j] - b[j])
            normals[1, i] = (d[j] - a[j]) * (c[k] - a[k]) - (d[k] - a[k]) * (c[j] - a[j])
            normals[2, i] = (b[j] - a[j]) * (d[k] - a[k]) - (b[k] - a[k]) * (d[j] - a[j])
            normals[3, i] = (c[j] - a[j]) * (b[k] - a[k]) - (c[k] - a[k]) * (b[j] - a[j])
        volume[e] /= 6
        if angles:
            for n in normals:
                length = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
                n /= length if length > 0 else 1.0
            # The edge between two corners is shared by the two faces opposite the other two corners.
            for edge, (i, j) in enumerate(EDGES):
                one, two = normals[i], normals[j]
                cosine = one[0] * two[0] + one[2] * two[2] + one[1] * two[1]
                cosines[e, edge] = min(max(-cosine, -1.0), 1.0)
    return volume, cosines
