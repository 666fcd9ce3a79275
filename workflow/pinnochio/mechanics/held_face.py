"""A face that is held: springs on the skin by which a learned method says what bone motion does not explain.

Where the face lies is wanted; how the tissue below gives way to that is left to mechanics. What the springs pull by in
the end is a load on the skin, so the field is in equilibrium with a load that is declared. It stands for what swells,
thins, unfurls, sags or is pulled there.
"""

import weakref
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy import sparse

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

# kPa a millimetre, of tissue of 4 kPa: the skin comes within 0.2 mm of where it is wanted; with 1 within 0.4, and more
# brings nothing that shows [X].
STIFFNESS = 10.0
# Of what is wanted, tried in turn where an element would be squeezed flat: on 1 of 40 patients half serves [X].
SHARES = 1.0, 0.5, 0.25


class HeldFace:
    """The springs of one patient's judged face. loads: the springs, without a pull, as the solvers take them."""

    def __init__(self, model: PatientModel, fem: FemSettings):
        self._model, self._fem, self._onto = model, fem, model.onto_judged
        self._stiffness = STIFFNESS * model.judged_areas  # mN/mm
        springs = self._onto.T @ sparse.diags_array(self._stiffness) @ self._onto
        self.loads = Loads(np.zeros_like(model.points), springs=sparse.csr_array(springs))

    def pull(self, wanted: np.ndarray, base: np.ndarray | None = None) -> np.ndarray:
        """What the springs pull by at rest (n, 3) mN: `wanted` (k, 3) mm beside where a base (n, 3) mm has the face."""
        there = wanted if base is None else wanted + self._onto @ base
        return self._onto.T @ (self._stiffness[:, None] * there)

    def force(self, pull: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Force (n, 3) mN of the springs at a displacement (n, 3) mm: what the field declares."""
        return pull - self.loads.springs @ displacement

    def answer(self, wanted: np.ndarray) -> np.ndarray:
        """Displacement (n, 3) mm by which tissue at rest answers the pull, to first order, sliding nodes free."""
        return self._elastic.under(self.pull(wanted)[None])[0]

    @cached_property
    def _elastic(self) -> ElasticSolver:
        model, fem = self._model, self._fem
        rest = replace(boundary_conditions(model, Plan("-", {}), "mucosa"), loads=self.loads)
        solver = ElasticSolver(model.points, model.cells, fem.material(model.tissue), rest, fem.volumetric)
        weakref.finalize(self, solver.close)
        return solver
