"""Linear elasticity of one patient: factorised once, then milliseconds per plan."""

import copy

import numpy as np

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.constraints import Constraints
from pinnochio.mechanics.boundary.loads import Loads, OuterForces
from pinnochio.mechanics.elements.assembly import Assembler
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC, Elements
from pinnochio.mechanics.solvers.linear_algebra import linear_solver


class ElasticSolver:
    """The tangent of the energy at rest, with its factors, for one mesh and one set of constrained nodes.

    points (n, 3) mm, cells (m, 4). A sliding node moves with its bone along the normal that the bone's surface has at
    rest and is free across it. Exact to first order in the motion: a rotation by 10
    degrees already stretches by 1.5 %. Contact sets are refused, because they open and close. The tension of surfaces
    is that of the first boundary condition.
    single: factors in single precision. elements, constraints: of the mesh and of the first boundary condition; outer:
    its forces beside those of the elements; frames (s, 3, 3): axes of the sliding nodes at rest.
    """

    def __init__(
        self,
        points,
        cells,
        material: Material,
        boundary: BoundaryConditions,
        volumetric: str = VOLUMETRIC[0],
        linear_solver_kind: str = "auto",
        single: bool = False,
    ):
        self.elements = elements = Elements.build(points, cells, material, volumetric)
        self.constraints = Constraints(points, elements.cells, boundary)
        rest = np.zeros((elements.nodes, 3))
        self.frames = self.constraints.sliding.bones.frames
        self.outer = outer = OuterForces(points, boundary.loads)
        whole = Assembler(elements, np.zeros(rest.shape, bool), self.constraints.sliding.nodes, outer.pairs)
        data = whole.tangent(rest, self.frames)[0]
        whole.add(data, outer.pairs, self.constraints.turned(outer.blocks, outer.pairs, self.frames))
        upper, fixed = whole.upper(data), self.constraints.constrained[whole.free]
        upper.eliminate_zeros()
        free = upper[~fixed]
        inner = free[:, ~fixed]
        inner.sort_indices()
        self._coupling = free[:, fixed] + upper[fixed][:, ~fixed].T.tocsr()
        self._fixed, self._used = fixed, whole.free
        self._linear = linear_solver(inner.indptr, inner.indices, linear_solver_kind, single)
        if not self._linear.factorize(inner.data):
            raise RuntimeError("the stiffness at rest is not positive definite to working precision")

    def of(self, material: Material, loads: Loads | None) -> "ElasticSolver":
        """The same factors, for elements of another material under another tension, of which they are not."""
        other = copy.copy(self)
        other.elements = self.elements.of(material)
        other.outer = OuterForces(self.constraints.points, loads)
        return other

    def solve(self, boundary: BoundaryConditions) -> np.ndarray:
        """Displacement (n, 3) in mm at full load; the boundary differs from the first one in its motion and its dead
        forces alone."""
        if boundary.contact:
            raise InputError("-", "boundary", "has contact sets", "solve it by Newton's method")
        moved = self.spread(self.constraints.under(boundary).motions()[None])[0]
        return moved + self.under(boundary.loads.forces[None])[0] if boundary.loads else moved

    def spread(self, motions: np.ndarray) -> np.ndarray:
        """Fields (k, n, 3) mm in equilibrium with displacements `motions` (k, n, 3) mm of the constrained nodes.

        Of a sliding node the component along its normal is read, of a node without condition nothing.
        """
        fields = np.where(self.constraints.constrained, self._local(motions), 0)
        unknowns = fields[:, self._used]
        return self._answered(fields, -(self._coupling @ unknowns[:, self._fixed].T).T)

    def under(self, forces: np.ndarray) -> np.ndarray:
        """Fields (k, n, 3) mm in equilibrium with dead forces (k, n, 3) mN, sliding nodes free along their bone, all
        other constrained ones at rest."""
        loads = self._local(forces)[:, self._used][:, ~self._fixed]
        return self._answered(np.zeros(np.shape(forces)), loads)

    def respond(self, loads: np.ndarray) -> np.ndarray:
        """Free unknowns (k, f) mm, in the axes at rest, under loads (k, f) mN on them while all others rest."""
        return self._linear.solve(loads)

    def _local(self, fields: np.ndarray) -> np.ndarray:
        return np.stack([self.constraints.local(field, self.frames) for field in fields])

    def _answered(self, fields: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """The fields (k, n, 3), in the axes at rest, with what loads (k, f) do to the free unknowns; in the world's."""
        unknowns = fields[:, self._used]
        unknowns[:, ~self._fixed] = self.respond(loads)
        fields[:, self._used] = unknowns
        return np.stack([self.constraints.world(field, self.frames) for field in fields])

    def close(self) -> None:
        """Release the factors."""
        self._linear.close()
