"""Plans of one patient, each solved on what it requires of the patient."""

import logging
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import PlanSolver, by_kept_factors, solver_options
from pinnochio.mechanics.solvers.kept_factors import RepeatedSolver
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import SolveResult, solve
from pinnochio.mechanics.solvers.reduced import moved_cells, restricted
from pinnochio.model.patient import NOT_LIP, PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import known_role

# Largest share of the cells that is solved alone: more pays little for factors of its own, and with both jaws moving
# far the linear field errs by tenths of millimetres where the cut would be [X: docs/scene.md].
WORTH = 0.5


def solver_of(patient: PatientModel, arm: str, settings: FemSettings, limit: float) -> "PlanSolver | ReducedSolver":
    """The solver of a patient's plans: of what each requires, or without a limit of all."""
    return ReducedSolver(patient, arm, settings, limit) if limit else PlanSolver(patient, arm, settings)


class ReducedSolver:
    """As :class:`pinnochio.mechanics.simulation.PlanSolver`, but that of each plan only the cells are solved that
    linear elasticity moves by more than `limit` mm, with those of lips in contact; all else moves by the linear field.
    Where that does not pay, or does not converge, all cells are.

    The linear map is the patient's stiffness at rest, factorised once, as PlanSolver does too; Newton's method, which
    keeps no factors, makes it for the first plan that may require less than all.
    """

    def __init__(self, patient: PatientModel, arm: str, settings: FemSettings, limit: float):
        began = time.perf_counter()
        self._patient, self._arm, self._settings, self._limit = patient, arm, settings, limit
        self._kept = by_kept_factors(arm, settings)
        self._lips = np.flatnonzero(patient.lip != NOT_LIP) if arm == "mucosa+lip" else []
        self._map: ElasticSolver | None = None
        self._mappable = True  # until the stiffness at rest cannot be factorised
        self._whole: RepeatedSolver | None = None
        if self._kept:
            self._field(self._boundary(Plan("rest", {})))
        self.preparation = time.perf_counter() - began

    def solve(self, plans: Sequence[Plan]) -> list[SolveResult]:
        """Displacement of every node under each plan."""
        return [self._solved(plan) for plan in plans]

    def required(self, plan: Plan) -> np.ndarray:
        """Cells (m,) bool that are solved: all of them where fewer do not pay."""
        return self._required(plan, self._boundary(plan))[0]

    def close(self) -> None:
        """Release the factors."""
        if self._map is not None:
            self._map.close()

    def _solved(self, plan: Plan) -> SolveResult:
        began, result = time.perf_counter(), None
        boundary = self._boundary(plan)
        wanted, field = self._required(plan, boundary)
        logging.info("%s: %.0f %% of the cells are solved", plan.case, 100 * wanted.mean())
        if not wanted.all():
            result = self._part(boundary, wanted, field)
        if result is None or not result.converged:
            result = self._all(boundary, field)
        return replace(result, seconds=time.perf_counter() - began)

    def _required(self, plan: Plan, boundary: BoundaryConditions) -> tuple[np.ndarray, np.ndarray | None]:
        """Cells (m,) bool that are solved and the linear field (n, 3) mm, None where it is not asked for or not had."""
        every = np.ones(len(self._patient.cells), bool)
        if not self._kept and self._wide(plan):
            return every, None
        field = self._field(boundary)
        if field is None:
            return every, None
        wanted = moved_cells(self._patient.cells, field, self._limit, self._lips)
        return (wanted if 0 < wanted.mean() <= WORTH else every), field

    def _wide(self, plan: Plan) -> bool:
        """Whether bones of several roles move, as the parts of a lower jaw do, or both jaws: most cells then move, too
        many to make the map for [X]."""
        length = np.linalg.norm(self._patient.bone_displacement(plan), axis=1)
        moved = np.unique(self._patient.bone_segment[length > self._limit])
        return len({known_role(self._patient.segments[index]) for index in moved}) > 1

    def _field(self, boundary: BoundaryConditions) -> np.ndarray | None:
        """The linear field (n, 3) mm, lips free to enter each other; None where the stiffness has no factors."""
        boundary = replace(boundary, contact=[])
        if self._map is None and self._mappable:
            fem, patient = self._settings, self._patient
            own = patient.points, patient.cells, fem.material(patient.tissue), boundary
            try:
                self._map = ElasticSolver(*own, fem.volumetric, fem.linear_solver, single=True)
            except RuntimeError as error:
                logging.warning("no kept factors: %s", error)
                self._mappable = False
        return None if self._map is None else self._map.solve(boundary)

    def _part(self, boundary: BoundaryConditions, wanted: np.ndarray, field: np.ndarray) -> SolveResult:
        """The cells `wanted` (m,) bool solved, the linear field (n, 3) mm elsewhere."""
        nodes, cells, boundary = restricted(boundary, self._patient.cells, wanted, field)
        problem = self._patient.points[nodes], cells, *self._problem(boundary, wanted)
        if self._kept:
            solver = RepeatedSolver(*problem)
            (result,) = solver.solve([boundary])
            solver.close()
        else:
            result = solve(*problem)
        displacement = field.copy()
        displacement[nodes] = result.displacement
        return replace(result, displacement=displacement)

    def _all(self, boundary: BoundaryConditions, field: np.ndarray | None) -> SolveResult:
        """All cells, by the factors of the linear map where factors are kept; field (n, 3) mm: the linear one."""
        problem = self._patient.points, self._patient.cells, *self._problem(boundary, slice(None))
        if not self._kept or field is None:
            return solve(*problem)
        if self._whole is None:
            self._whole = RepeatedSolver(*problem, self._map)
        return self._whole.solve([boundary], linear=[field])[0]

    def _problem(self, boundary: BoundaryConditions, cells) -> tuple:
        law = self._settings.material(self._patient.tissue[cells])
        return law, boundary, solver_options(self._settings)

    def _boundary(self, plan: Plan) -> BoundaryConditions:
        return boundary_conditions(self._patient, plan, self._arm)
