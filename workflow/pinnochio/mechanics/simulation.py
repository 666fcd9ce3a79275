"""The one door to mechanics: from plans of a patient to the displacement of every node."""

import logging
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinnochio.errors import InputError
from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.inversion_repair import volume_ratios
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import SolveResult, solve
from pinnochio.mechanics.solvers.reduced import moved_cells, moves_widely, pays, restricted
from pinnochio.model.patient import NOT_LIP, PatientModel
from pinnochio.plans.plan import Plan


def simulate(
    patient: PatientModel,
    plans: Sequence[Plan],
    settings: FemSettings,
    forces: Sequence[np.ndarray] | None = None,
    **options,
) -> list[SolveResult]:
    """Displacement of every node under each plan, by a :class:`Simulator` that is made for this call.

    options: as of the Simulator. forces: as of :meth:`Simulator.solve`.
    """
    with Simulator(patient, settings, **options) as simulator:
        return simulator.solve(plans, forces)


class Simulator:
    """Plans of one patient, for whom what is the same under every plan is made once; a context releases it.

    arm: one of `conditions.ARMS`; unilateral: as in boundary_conditions; loads: forces beside those of the elements.
    The way to equilibrium follows from the rest:

    * linear: linear elasticity alone, milliseconds per plan; the field may hold inverted elements.
    * settings.kept_factors: steps on the factors of the stiffness at rest (:mod:`solvers.kept_factors`), and by
      Newton's method what they do not solve. Contact is left to Newton's method.
    * else Newton's method (:mod:`solvers.newton`), one plan after the other.
    * amplitude, in mm, if not 0: of each plan only the cells are solved that linear elasticity moves by more, with
      those of lips in contact, and all else moves by the linear field. Where that does not pay, or does not converge,
      all cells are (:mod:`solvers.reduced`).

    preparation: seconds that the patient took. InputError where what is wished does not go together.
    """

    def __init__(
        self,
        patient: PatientModel,
        settings: FemSettings,
        arm: str = "mucosa",
        *,
        unilateral: bool = False,
        loads: Loads | None = None,
        linear: bool = False,
        amplitude: float = 0.0,
    ):
        began = time.perf_counter()
        if amplitude and (unilateral or loads or linear):
            raise InputError("-", "options", "a part of the cells is solved", "leave out loads, unilateral, linear")
        self._patient, self._settings, self._arm = patient, settings, arm
        self._unilateral, self._loads, self._linear, self._amplitude = unilateral, loads, linear, amplitude
        self._law = settings.material(patient.tissue)
        self._lips = np.flatnonzero(patient.lip != NOT_LIP) if arm == "mucosa+lip" else []
        contact = unilateral or arm == "mucosa+lip"
        self._keeps = settings.kept_factors and not (linear or contact)
        self._elastic: ElasticSolver | None = None
        self._singular = False  # whether the stiffness at rest was found to have no factors
        self._kept = self._keep() if self._keeps else None
        self.preparation = time.perf_counter() - began

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def solve(self, plans: Sequence[Plan], forces: Sequence[np.ndarray] | None = None) -> list[SolveResult]:
        """Displacement of every node under each plan; forces: dead forces (n, 3) mN of each, if not that of `loads`."""
        if self._amplitude:
            if forces is not None:
                raise InputError("-", "options", "a part of the cells is solved", "leave out the forces")
            return [self._reduced(plan) for plan in plans]
        boundaries = [self._boundary(plan) for plan in plans]
        if forces is not None:
            dead = [replace(self._loads, forces=force) if self._loads else Loads(force) for force in forces]
            boundaries = [replace(item, loads=loads) for item, loads in zip(boundaries, dead, strict=True)]
        if self._linear:
            return [self._linear_result(boundary) for boundary in boundaries]
        if self._kept is not None:
            return self._kept.solve(boundaries)
        mesh = self._patient.points, self._patient.cells
        return [solve(*mesh, self._law, boundary, self._settings) for boundary in boundaries]

    def required(self, plan: Plan) -> np.ndarray:
        """Cells (m,) bool that are solved of a plan: all of them where fewer do not pay."""
        return self._required(plan, self._boundary(plan))[0]

    def close(self) -> None:
        """Release the factors."""
        if self._kept is not None:
            self._kept.close()
        elif self._elastic is not None:
            self._elastic.close()

    def _boundary(self, plan: Plan) -> BoundaryConditions:
        boundary = boundary_conditions(self._patient, plan, self._arm, self._unilateral)
        return replace(boundary, loads=self._loads)

    def _keep(self) -> KeptFactors | None:
        """The solver by kept factors, None where the stiffness at rest has none."""
        rest = self._boundary(Plan("rest", {}))
        elastic = self._factors(rest)
        if elastic is None:
            return None
        return KeptFactors(self._patient.points, self._patient.cells, self._law, rest, self._settings, elastic)

    def _factors(self, boundary: BoundaryConditions) -> ElasticSolver | None:
        """The stiffness at rest with its factors, made once; None where it has none."""
        if self._elastic is None and not self._singular:
            try:
                self._elastic = self._linear_elasticity(replace(boundary, contact=[]), single=True)
            except RuntimeError as error:
                logging.warning("no kept factors: %s", error)
                self._singular = True
        return self._elastic

    def _linear_elasticity(self, boundary: BoundaryConditions, single: bool) -> ElasticSolver:
        mesh, settings = (self._patient.points, self._patient.cells), self._settings
        return ElasticSolver(*mesh, self._law, boundary, settings.volumetric, settings.linear_solver, single)

    def _linear_result(self, boundary: BoundaryConditions) -> SolveResult:
        began = time.perf_counter()
        if self._elastic is None:
            self._elastic = self._linear_elasticity(boundary, single=False)
        field = self._elastic.solve(boundary)
        least = float(volume_ratios(self._patient.points, self._patient.cells, field).min())
        return SolveResult.linear(field, least, time.perf_counter() - began)

    # ---- a part of the cells

    def _reduced(self, plan: Plan) -> SolveResult:
        began, result = time.perf_counter(), None
        boundary = self._boundary(plan)
        required, field = self._required(plan, boundary)
        logging.info("%s: %.0f %% of the cells are solved", plan.case, 100 * required.mean())
        if not required.all():
            result = self._part(boundary, required, field)
        if result is None or not result.converged:
            result = self._all(boundary, field)
        return replace(result, seconds=time.perf_counter() - began)

    def _required(self, plan: Plan, boundary: BoundaryConditions) -> tuple[np.ndarray, np.ndarray | None]:
        """Cells (m,) bool that are solved and the linear field (n, 3) mm, lips free to enter each other; None where it
        is not needed or not had."""
        every = np.ones(len(self._patient.cells), bool)
        # Newton's method keeps no factors: they are made for the first plan that may require less than all.
        if not self._keeps and moves_widely(self._patient, plan, self._amplitude):
            return every, None
        elastic = self._factors(boundary)
        if elastic is None:
            return every, None
        field = elastic.solve(replace(boundary, contact=[]))
        required = moved_cells(self._patient.cells, field, self._amplitude, self._lips)
        return (required if pays(required) else every), field

    def _part(self, boundary: BoundaryConditions, required: np.ndarray, field: np.ndarray) -> SolveResult:
        """The cells `required` (m,) bool solved, the linear field (n, 3) mm elsewhere."""
        nodes, cells, boundary = restricted(boundary, self._patient.cells, required, field)
        law = self._settings.material(self._patient.tissue[required])
        problem = self._patient.points[nodes], cells, law, boundary, self._settings
        if self._keeps:
            solver = KeptFactors(*problem)
            (result,) = solver.solve([boundary])
            solver.close()
        else:
            result = solve(*problem)
        displacement = field.copy()
        displacement[nodes] = result.displacement
        return replace(result, displacement=displacement)

    def _all(self, boundary: BoundaryConditions, field: np.ndarray | None) -> SolveResult:
        """All cells; field (n, 3) mm: the linear one."""
        if self._kept is not None:
            return self._kept.solve([boundary], linear=[field])[0]
        return solve(self._patient.points, self._patient.cells, self._law, boundary, self._settings)
