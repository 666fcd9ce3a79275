"""Linear elasticity with sliding interfaces, factorised once per patient."""

from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np

from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction
from pinnochio.plans.plan import Plan
from pinnochio.timing import timed


def linear_field(
    patient: PatientModel, plan: Plan, fem: FemSettings, warm: bool = True
) -> tuple[np.ndarray, float, float]:
    """Displacement (n, 3) mm by linear elasticity with sliding interfaces, timed as in `timing.timed`.

    A linear field may hold inverted elements.
    """
    with ExitStack() as stack:

        def prepare():
            simulator = stack.enter_context(Simulator(patient, fem, linear=True))
            return lambda: simulator.solve([plan])[0].displacement

        return timed(prepare, warm)


class ElasticPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`; settings: fem."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        self._fem, self._threads = FemSettings(**settings["fem"]), threads

    def __call__(self, planned: Planned) -> Prediction:
        """As linear_field does."""
        return Prediction(*linear_field(planned.patient, planned.plan, self._fem, planned.warm), self._threads)
