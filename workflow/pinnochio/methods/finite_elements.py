"""Finite elements: a plan solved on a patient."""

import logging
from collections.abc import Mapping
from dataclasses import replace

from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import PlanSolver, simulate
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.reduction.solver import ReducedSolver, solver_of


class Predictor:
    """As :class:`pinnochio.methods.protocol.Predictor`.

    settings: fem; contact: one of `sliding.ARMS`; region: amplitude in mm below which a plan leaves tissue to
    linear elasticity, 0 to solve all. What belongs to the patient is kept for further
    plans of the same one. The first patient's solve is begun once more beforehand, and solved by kept factors, so that
    no timing holds the loading of compiled code.
    """

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._fem, self._contact = FemSettings(**settings["fem"]), settings["contact"]
        self._region, self._threads, self._warm = settings.get("region", 0.0), threads, False
        self._patient: PatientModel | None = None
        self._solver: PlanSolver | ReducedSolver | None = None

    def __call__(self, planned: Planned) -> Prediction:
        """A solve that stops early is returned as such, with the last good state."""
        if not self._warm:
            self._warm_up(planned)
        solver = self._solver_of(planned.patient)
        (result,) = solver.solve([planned.plan])
        logging.info("%s: %s", planned.case, result.reason)
        return Prediction(
            result.displacement,
            seconds=result.seconds,
            setup_seconds=solver.preparation,
            threads=self._threads,
            converged=result.converged,
            reason=result.reason,
            iterations=result.iterations,
            load=result.fraction,
        )

    def _solver_of(self, patient: PatientModel) -> PlanSolver | ReducedSolver:
        """The solver of the patient, of one at a time."""
        if self._patient is not patient:
            if self._solver is not None:
                self._solver.close()
            self._solver = solver_of(patient, self._contact, self._fem, self._region)
            self._patient = patient
        return self._solver

    def _warm_up(self, planned: Planned) -> None:
        """Load the compiled code of what may come."""
        newton = replace(self._fem, time_limit=1e-3, kept_factors=False)
        simulate(planned.patient, planned.plan, self._contact, newton)
        if self._fem.kept_factors:
            self._solver_of(planned.patient).solve([planned.plan])
            self._patient = None
        self._warm = True
