"""The face that a plan leads to: at once by the elastic map, and by finite elements with sliding interfaces."""

import numpy as np

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.lift import segment_motions
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import SolveResult
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan


class ElasticFace:
    """One patient whose face answers many plans; what belongs to the patient is made once.

    response (12 K, 3 n): displacement of the nodes, mm, per unit of each amplitude of
    :func:`pinnochio.mechanics.lift.motion_amplitudes`, in equilibrium to first order with sliding interfaces.
    """

    def __init__(self, model: PatientModel, fem: FemSettings):
        self.model = model
        rest = boundary_conditions(model, Plan("-", {}), "mucosa")
        law = fem.material(model.tissue)
        elastic = ElasticSolver(model.points, model.cells, law, rest, fem.volumetric, fem.linear_solver)
        fields = elastic.spread(segment_motions(model, model.points.mean(axis=0)))
        elastic.close()
        self.response = fields.reshape(len(fields), -1)
        self._simulator = Simulator(model, fem)

    def elastic(self, amplitudes: np.ndarray) -> np.ndarray:
        """Displacement (n, 3) mm to first order under amplitudes (12 K,) of the bones' motions."""
        return (amplitudes @ self.response).reshape(-1, 3)

    def solve(self, plan: Plan) -> SolveResult:
        """Finite elements of the plan."""
        return self._simulator.solve([plan])[0]

    def close(self) -> None:
        """Release the factors."""
        self._simulator.close()
