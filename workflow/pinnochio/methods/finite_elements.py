"""Finite elements: a plan solved on a patient."""

import logging
from collections.abc import Mapping
from dataclasses import replace

from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.methods.protocol import Planned
from pinnochio.model.predictions import Prediction


class Predictor:
    """As :class:`pinnochio.methods.protocol.Predictor`.

    settings: fem; contact: one of `sliding.ARMS`; apart in mm: as in boundary_conditions. The first patient's solve is
    begun once more beforehand, so that no timing holds the loading of compiled code.
    """

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._fem, self._contact, self._apart = FemSettings(**settings["fem"]), settings["contact"], settings["apart"]
        self._threads, self._warm = threads, False

    def __call__(self, planned: Planned) -> Prediction:
        """A solve that stops early is returned as such, with the last good state."""
        if not self._warm:
            self._solve(planned, replace(self._fem, time_limit=1e-3))
            self._warm = True
        result = self._solve(planned, self._fem)
        logging.info("%s: %s", planned.case, result.reason)
        return Prediction(
            result.displacement,
            seconds=result.seconds,
            threads=self._threads,
            converged=result.converged,
            reason=result.reason,
            iterations=result.iterations,
            load=result.fraction,
        )

    def _solve(self, planned: Planned, fem: FemSettings):
        return simulate(planned.patient, planned.plan, self._contact, fem, self._apart)
