"""Linear elasticity with sliding interfaces, factorised once per patient."""

from collections.abc import Mapping

from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate_elastic
from pinnochio.methods.protocol import Planned
from pinnochio.model.predictions import Prediction


class Predictor:
    """As :class:`pinnochio.methods.protocol.Predictor`; settings: fem."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._fem, self._threads = FemSettings(**settings["fem"]), threads

    def __call__(self, planned: Planned) -> Prediction:
        """Warm, as simulate_elastic does."""
        return Prediction(*simulate_elastic(planned.patient, planned.plan, self._fem), self._threads)
