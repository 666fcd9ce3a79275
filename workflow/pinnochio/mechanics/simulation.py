"""The one door to mechanics: from plans of a patient to the displacement of every node."""

import copy
import logging
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import sparse

from pinnochio.mechanics.boundary.conditions import BoundaryConditions, boundary_conditions
from pinnochio.mechanics.boundary.loads import Loads
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.settings import EXACT, FemSettings
from pinnochio.mechanics.solvers.kept_factors import KeptFactors
from pinnochio.mechanics.solvers.linear_elasticity import ElasticSolver
from pinnochio.mechanics.solvers.newton import SolveResult, solve
from pinnochio.model.patient import PatientModel
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

    arm: one of `conditions.ARMS`; loads: forces beside those of the elements; everywhere: settings.accuracy counts at
    every node, not on the judged face alone.
    The way to equilibrium follows from the rest:

    * linear: linear elasticity alone, milliseconds per plan; the field may hold inverted elements.
    * settings.kept_factors: steps on the factors of the stiffness at rest (:mod:`solvers.kept_factors`), and by
      Newton's method what they do not solve. Contact is left to Newton's method.
    * else Newton's method (:mod:`solvers.newton`), one plan after the other.

    preparation: seconds that the patient took.
    """

    def __init__(
        self,
        patient: PatientModel,
        settings: FemSettings,
        arm: str = "mucosa",
        *,
        loads: Loads | None = None,
        linear: bool = False,
        everywhere: bool = False,
    ):
        began = time.perf_counter()
        self._patient, self._settings, self._arm = patient, settings, arm
        self._loads, self._linear, self._everywhere = loads, linear, everywhere
        self._law = settings.material(patient.tissue)
        self._keeps = settings.kept_factors and not (linear or arm == "mucosa+lip")
        self._elastic: ElasticSolver | None = None
        self._kept = self._keep() if self._keeps else None
        self.preparation = time.perf_counter() - began

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def of(self, settings: FemSettings, loads: Loads | None) -> "Simulator":
        """The same patient of a tissue and loads near these, on the factors of this one, which releases them."""
        other = copy.copy(self)
        other._settings, other._loads, other._law = settings, loads, settings.material(self._patient.tissue)
        other._kept = self._kept and self._kept.of(other._law, loads)
        return other

    def solve(
        self, plans: Sequence[Plan], forces: Sequence[np.ndarray] | None = None, starts: np.ndarray | None = None
    ) -> list[SolveResult]:
        """Displacement of every node under each plan; forces: dead forces (n, 3) mN of each, if not that of `loads`;
        starts (k, n, 3) mm: fields that kept factors begin with, if not the linear ones."""
        boundaries = [self._boundary(plan) for plan in plans]
        if forces is not None:
            dead = [replace(self._loads, forces=force) if self._loads else Loads(force) for force in forces]
            boundaries = [replace(item, loads=loads) for item, loads in zip(boundaries, dead, strict=True)]
        if self._linear:
            return [self._linear_result(boundary) for boundary in boundaries]
        if self._kept is not None:
            return self._kept.solve(boundaries, starts)
        mesh = self._patient.points, self._patient.cells
        return [solve(*mesh, self._law, boundary, self._settings) for boundary in boundaries]

    def close(self) -> None:
        """Release the factors."""
        if self._kept is not None:
            self._kept.close()
        elif self._elastic is not None:
            self._elastic.close()

    def _boundary(self, plan: Plan) -> BoundaryConditions:
        boundary = boundary_conditions(self._patient, plan, self._arm)
        return replace(boundary, loads=self._loads)

    def _keep(self) -> KeptFactors | None:
        """The solver by kept factors, None where the stiffness at rest has none."""
        rest = self._boundary(Plan("rest", {}))
        try:
            self._elastic = self._linear_elasticity(rest, single=True)
        except RuntimeError as error:
            logging.warning("no kept factors: %s", error)
            return None
        mesh, watched = (self._patient.points, self._patient.cells), None
        if self._settings.accuracy != EXACT:
            count = len(self._patient.points)
            watched = sparse.eye_array(count) if self._everywhere else self._patient.onto_judged
        return KeptFactors(*mesh, self._law, rest, self._settings, self._elastic, watched)

    def _linear_elasticity(self, boundary: BoundaryConditions, single: bool) -> ElasticSolver:
        mesh, settings = (self._patient.points, self._patient.cells), self._settings
        return ElasticSolver(*mesh, self._law, boundary, settings.volumetric, settings.linear_solver, single)

    def _linear_result(self, boundary: BoundaryConditions) -> SolveResult:
        began = time.perf_counter()
        if self._elastic is None:
            self._elastic = self._linear_elasticity(boundary, single=False)
        field = self._elastic.solve(boundary)
        least = float(jacobians(self._patient.points, self._patient.cells, field).min())
        return SolveResult.linear(field, least, time.perf_counter() - began)
