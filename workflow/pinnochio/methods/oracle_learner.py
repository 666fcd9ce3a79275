"""The best that could be learned: what plan, anatomy and covariates decide of the outcome, all noise aside."""

from collections.abc import Mapping

import numpy as np

from pinnochio.geometry.interpolation import interpolate
from pinnochio.methods.protocol import Planned
from pinnochio.model.predictions import Prediction
from pinnochio.model.truth import read_expected, read_truth


class OracleLearnerPredictor:
    """As :class:`pinnochio.methods.protocol.Predictor`, without settings. A bound of the virtual cohort, no method."""

    def __init__(self, settings: Mapping, trained: str | None, device: str, threads: int):
        """Nothing of these is read."""

    def __call__(self, planned: Planned) -> Prediction:
        """The expected displacement of every node; nothing was computed, so no time is stated."""
        points, cells, *_ = read_truth(planned.truth, planned.case)
        expected = read_expected(planned.truth, planned.case)
        displacement = interpolate(planned.patient.points, points, cells, expected)
        return Prediction(displacement, np.nan, np.nan, threads=0, reason="the expected outcome")
