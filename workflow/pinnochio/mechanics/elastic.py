"""Linear elasticity of one patient: factorised once, then milliseconds per plan."""

import numpy as np
from scipy import sparse

from pinnochio.errors import InputError
from pinnochio.mechanics.assembly import Assembler
from pinnochio.mechanics.constraints import Constraints
from pinnochio.mechanics.elements import VOLUMETRIC, Elements
from pinnochio.mechanics.linear import linear_solver
from pinnochio.mechanics.materials import Material
from pinnochio.mechanics.sliding import BoundaryConditions


class ElasticSolver:
    """The tangent of the energy at rest, with its factors, for one mesh and one set of constrained nodes.

    points (n, 3) mm, cells (m, 4). A sliding node moves with its bone along the normal that the bone's surface has at
    rest and is free across it. Exact to first order in the motion: a rotation by 10
    degrees already stretches by 1.5 %. Contact sets are refused, because they open and close.
    """

    def __init__(
        self,
        points,
        cells,
        material: Material,
        boundary: BoundaryConditions,
        volumetric: str = VOLUMETRIC[0],
        linear_solver_kind: str = "auto",
    ):
        elements = Elements.build(points, cells, material, volumetric)
        self._constraints = Constraints(points, elements.cells, boundary)
        rest = np.zeros((elements.nodes, 3))
        self._frames = self._constraints.sliding.frames(rest, 0.0)
        whole = Assembler(elements, np.zeros(rest.shape, bool), self._constraints.sliding.nodes)
        upper = whole.upper(whole.tangent(rest, self._frames)[0])
        full = (upper + sparse.triu(upper, 1).T).tocsr()
        fixed = self._constraints.constrained[whole.free]
        own = sparse.triu(full[~fixed][:, ~fixed], format="csr")
        own.sort_indices()
        self._coupling, self._fixed, self._used = full[~fixed][:, fixed], fixed, whole.free
        self._linear = linear_solver(own.indptr, own.indices, 0, linear_solver_kind)
        if not self._linear.factorize(own.data):
            raise RuntimeError("the stiffness at rest is not positive definite to working precision")

    def solve(self, boundary: BoundaryConditions) -> np.ndarray:
        """Displacement (n, 3) in mm at full load; the boundary differs from the first one in its motion alone."""
        prescribed = np.asarray(boundary.prescribed_nodes, int)
        sliding = np.concatenate([np.zeros(0, int)] + [np.asarray(item.nodes, int) for item in boundary.sliding])
        same = np.array_equal(prescribed, self._constraints.prescribed)
        same &= np.array_equal(sliding, self._constraints.sliding.nodes)
        if boundary.contact or boundary.loads or not same:
            raise InputError("-", "boundary", "constrains other nodes than the factors are of", "make a new solver")
        motions = np.zeros(self._used.shape)
        motions[prescribed] = boundary.displacement(1.0)
        for item in boundary.sliding:
            motions[item.nodes] = item.motion(1.0).displacement(self._constraints.points[item.nodes])
        return self.spread(motions[None])[0]

    def spread(self, motions: np.ndarray) -> np.ndarray:
        """Fields (k, n, 3) mm in equilibrium with displacements `motions` (k, n, 3) mm of the constrained nodes.

        Of a sliding node the component along its normal is read, of a node without condition nothing.
        """
        fields = np.stack([self._constraints.local(field, self._frames) for field in motions])
        fields = np.where(self._constraints.constrained, fields, 0)
        unknowns = fields[:, self._used]
        load = -(self._coupling @ unknowns[:, self._fixed].T).T
        unknowns[:, ~self._fixed] = self._linear.solve(load)
        fields[:, self._used] = unknowns
        return np.stack([self._constraints.world(field, self._frames) for field in fields])

    def close(self) -> None:
        """Release the factors."""
        self._linear.close()
