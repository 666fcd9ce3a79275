"""The floor of the scan: the skin as it truly moved, which its own scan misses by noise and registration alone."""

from collections.abc import Mapping

import numpy as np

from pinnochio.geometry.interpolation import interpolate
from pinnochio.methods.protocol import Planned
from pinnochio.model.predictions import Prediction
from pinnochio.model.truth import read_truth


class ScanFloorPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`, without settings. A bound of the virtual cohort, no method."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        """Nothing of these is read."""

    def __call__(self, planned: Planned) -> Prediction:
        """The true displacement of the skin alone; nothing was computed, so no time is stated."""
        *field, _ = read_truth(planned.truth, planned.case)
        skin = interpolate(planned.patient.skin_points, *field)
        return Prediction(None, np.nan, np.nan, threads=0, reason="the truth", skin=skin)
