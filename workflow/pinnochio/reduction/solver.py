"""Plans of one patient, each solved on what it requires of the patient."""

import logging
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.repeated import RepeatedSolver
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import PlanSolver, solver_options
from pinnochio.mechanics.sliding import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.solver import SolveResult, solve
from pinnochio.model.patient import NOT_LIP, PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.reduction.region import moved_cells, restricted

# Largest share of the cells that is solved alone: more pays little for factors of its own, and with both jaws moving
# far the linear field errs by tenths of millimetres where the cut would be [X: docs/scene.md].
WORTH = 0.5


class ReducedSolver:
    """As :class:`PlanSolver`, but that of each plan only the cells are solved that linear elasticity moves by more than
    `limit` mm, with those of lips in contact; all else moves by the linear field. Where that does not pay, or does not
    converge, all cells are.

    The linear map is the patient's stiffness at rest, factorised once, as PlanSolver does too.
    """

    def __init__(self, patient: PatientModel, arm: str, settings: FemSettings, apart: float, limit: float):
        began = time.perf_counter()
        self._patient, self._arm, self._settings, self._apart, self._limit = patient, arm, settings, apart, limit
        self._kept = settings.kept_factors and arm != "mucosa+lip"
        self._lips = np.flatnonzero(patient.lip != NOT_LIP) if arm == "mucosa+lip" else []
        self._whole: PlanSolver | None = None
        self._map = ElasticSolver(
            patient.points,
            patient.cells,
            settings.material(patient.tissue),
            replace(self._boundary(Plan("rest", {})), contact=[]),
            settings.volumetric,
            settings.linear_solver,
            single=True,
        )
        self.preparation = time.perf_counter() - began

    def solve(self, plans: Sequence[Plan]) -> list[SolveResult]:
        """Displacement of every node under each plan."""
        return [self._solved(plan) for plan in plans]

    def required(self, boundary: BoundaryConditions) -> tuple[np.ndarray, np.ndarray]:
        """Cells (m,) bool to be solved, all of them where fewer do not pay, and the linear field (n, 3) mm."""
        field = self._map.solve(replace(boundary, contact=[]))
        wanted = moved_cells(self._patient.cells, field, self._limit, self._lips)
        return (wanted if 0 < wanted.mean() <= WORTH else np.ones_like(wanted)), field

    def close(self) -> None:
        """Release the factors."""
        self._map.close()

    def _solved(self, plan: Plan) -> SolveResult:
        began, result = time.perf_counter(), None
        boundary = self._boundary(plan)
        wanted, field = self.required(boundary)
        logging.info("%s: %.0f %% of the cells are solved", plan.case, 100 * wanted.mean())
        if not wanted.all():
            result = self._part(restricted(boundary, self._patient.cells, wanted, field), wanted)
        if result is None or not result.converged:
            (result,) = self._all().solve([plan])
        return replace(result, seconds=time.perf_counter() - began)

    def _part(self, boundary: BoundaryConditions, wanted: np.ndarray) -> SolveResult:
        """The cells `wanted` (m,) bool alone."""
        law = self._settings.material(self._patient.tissue[wanted])
        problem = self._patient.points, self._patient.cells[wanted], law, boundary, solver_options(self._settings)
        if not self._kept:
            return solve(*problem)
        solver = RepeatedSolver(*problem)
        (result,) = solver.solve([boundary])
        solver.close()
        return result

    def _all(self) -> PlanSolver:
        """The solver of the whole patient, on the factors of the linear map."""
        if self._whole is None:
            self._whole = PlanSolver(self._patient, self._arm, self._settings, self._apart, self._map)
        return self._whole

    def _boundary(self, plan: Plan) -> BoundaryConditions:
        return boundary_conditions(self._patient, plan, self._arm, apart=self._apart)
