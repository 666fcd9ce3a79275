"""The floor: the face stays as it was."""

from collections.abc import Mapping

import numpy as np

from pinnochio.methods.protocol import Planned
from pinnochio.model.predictions import Prediction


class NoChangePredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`, without settings."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        """Nothing of these is read."""

    def __call__(self, planned: Planned) -> Prediction:
        """No displacement at all."""
        return Prediction(np.zeros_like(planned.patient.points))
