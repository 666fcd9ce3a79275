"""Forces on a mesh beside those of its elements: dead forces, springs that hold nodes, and a tension of surfaces that
was there before.

The tension T (mN/mm) of a surface that is in equilibrium at rest, with whatever it presses on, acts by its change
alone: the second-order part of its energy, T/2 sum of A |grad u|^2 over the triangles with their area A at rest
(initial-stress stiffness of a second Piola-Kirchhoff tension that stays). The forces that balance it at rest are taken
to stay as they are, so that a translation meets no resistance, and a turn of a curved surface some [I].
"""

import copy
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from pinnochio.errors import InputError
from pinnochio.geometry.triangles import face_normals


@dataclass(frozen=True)
class Loads:
    """forces (n, 3) mN at the end, applied in proportion; faces (f, 3) of the mesh with their tension (f,) mN/mm.

    springs (n, n) mN/mm, for each axis alike, resist displacement; what they pull by at rest is among the forces.
    """

    forces: np.ndarray
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), int))
    tension: np.ndarray = field(default_factory=lambda: np.zeros(0))
    springs: sparse.csr_array | None = None


class OuterForces:
    """Energy, its gradient and its Hessian of the loads of one mesh, points (n, 3) mm; of none without loads.

    pairs (c, 2): node pairs a <= b that tension and springs couple; blocks (c, 3, 3) in mN/mm: the Hessian there.
    """

    def __init__(self, points, loads: Loads | None):
        points = np.asarray(points, float)
        loads = loads or Loads(np.zeros_like(points))
        self.forces, faces, tension = np.asarray(loads.forces, float), loads.faces, loads.tension
        if self.forces.shape != points.shape or not np.isfinite(self.forces).all():
            raise InputError("-", "loads", f"forces of shape {self.forces.shape}", "give (n, 3), finite, in mN")
        if len(tension) != len(faces) or not np.isfinite(tension).all() or (np.asarray(tension) < 0).any():
            raise InputError("-", "loads", "tension must be finite, not negative, one per triangle", "mend it")
        stiffness = surface_stiffness(points, np.asarray(faces, int), np.asarray(tension, float))
        self._couple(stiffness if loads.springs is None else sparse.csr_array(stiffness + loads.springs))

    def _couple(self, stiffness: sparse.csr_array) -> None:
        self.stiffness, upper = stiffness, sparse.triu(stiffness).tocoo()
        self.pairs = np.column_stack([upper.row, upper.col]).astype(np.int64)
        self.blocks = upper.data[:, None, None] * np.eye(3)

    @property
    def act(self) -> bool:
        """Whether there are any."""
        return self.stiffness.nnz > 0 or bool(self.forces.any())

    def under(self, forces) -> "OuterForces":
        """The same tension and springs with other dead forces (n, 3) mN, as another plan has them; none for None."""
        other = copy.copy(self)
        other.forces = np.zeros_like(self.forces) if forces is None else np.asarray(forces, float)
        return other

    def part(self, nodes) -> "OuterForces":
        """What acts on some nodes (k,) of the mesh: as long as all others rest, its energy and force change as the
        whole's do."""
        other = copy.copy(self)
        other.forces = self.forces[nodes]
        other._couple(self.stiffness[nodes][:, nodes])
        return other

    def evaluate(self, displacement, fraction: float) -> tuple[float, np.ndarray]:
        """Energy in mN mm and its gradient (n, 3) in mN at a displacement (n, 3) mm and a fraction of the load."""
        pull, dead = self.stiffness @ displacement, fraction * self.forces
        return float(0.5 * np.vdot(displacement, pull) - np.vdot(dead, displacement)), pull - dead


def surface_stiffness(points, faces, tension) -> sparse.csr_array:
    """Matrix (n, n) in mN/mm, for each axis alike, of the tension (f,) mN/mm of triangles (f, 3)."""
    normals, areas = face_normals(points, faces)
    corners = points[faces]
    opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]  # the edge across from each corner
    gradients = np.cross(normals[:, None], opposite) / np.maximum(2 * areas, 1e-12)[:, None, None]
    blocks = np.einsum("f,fax,fbx->fab", tension * areas, gradients, gradients)
    rows, columns = np.repeat(faces, 3, axis=1), np.tile(faces, 3)
    shape = (len(points), len(points))
    return sparse.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape).tocsr()
