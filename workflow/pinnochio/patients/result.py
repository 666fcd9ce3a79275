"""What a method predicts of a new patient, whichever way it is made."""

import os

import numpy as np

from pinnochio.hdf5 import reading
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.model.regions import NOT_JUDGED
from pinnochio.statistics.intervals import Interval


def read_result(path: str | os.PathLike, case: str, patient: PatientModel) -> Interval:
    """The interval of an ensemble, or the prediction of a method without one: its half-width is NaN everywhere."""
    with reading(path) as file:
        if "half_width" in file:
            return Interval.read(path)
    points, skin = len(patient.points), len(patient.skin_points)
    displacement = read_prediction(path, case).displacement
    return Interval(displacement, np.zeros(points), np.full(skin, np.nan), np.full(skin, NOT_JUDGED, np.int8))
