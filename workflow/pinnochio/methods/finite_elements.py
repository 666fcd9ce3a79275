"""Finite elements: a plan solved on a patient."""

import logging
from collections.abc import Mapping
from dataclasses import replace

from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator, simulate
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction


class FiniteElementPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`.

    settings: fem; contact: one of `conditions.ARMS`. What belongs to the patient is kept for further plans of the same
    one. The first patient is solved once more beforehand, by Newton's method for one step, so that no timing holds the
    loading of compiled code.
    """

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._fem, self._contact = FemSettings(**settings["fem"]), settings["contact"]
        self._threads, self._warm = threads, False
        self._patient: PatientModel | None = None
        self._simulator: Simulator | None = None

    def __call__(self, planned: Planned) -> Prediction:
        """A solve that stops early is returned as such, with the last good state."""
        if planned.warm and not self._warm:
            self._warm_up(planned)
        simulator = self._simulator_of(planned.patient)
        (result,) = simulator.solve([planned.plan])
        logging.info("%s: %s", planned.case, result.reason)
        return Prediction(
            result.displacement,
            seconds=result.seconds,
            setup_seconds=simulator.preparation,
            threads=self._threads,
            converged=result.converged,
            reason=result.reason,
            iterations=result.iterations,
            load=result.fraction,
        )

    def _simulator_of(self, patient: PatientModel) -> Simulator:
        """That of the patient, of one at a time."""
        if self._patient is not patient:
            if self._simulator is not None:
                self._simulator.close()
            self._simulator = Simulator(patient, self._fem, self._contact)
            self._patient = patient
        return self._simulator

    def _warm_up(self, planned: Planned) -> None:
        """Load the compiled code of what may come: a solve by kept factors, or the first step of Newton's method."""
        simulate(planned.patient, [planned.plan], replace(self._fem, max_systems=1), arm=self._contact)
        self._warm = True
