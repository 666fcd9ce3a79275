"""Makes the prediction of a new patient with its calibrated interval."""

import logging
from dataclasses import asdict, replace

import numpy as np

from pinnochio.mechanics.settings import FemSettings
from pinnochio.patients.result import of_ensemble, read_patient
from pinnochio.statistics.intervals import Calibration, read_ensemble, read_load, repaired_interval, widened


def predict_interval(
    case: str, model: str, ensemble: str, calibration: str, widening: float, fem: FemSettings, result: str
) -> None:
    """Write the interval of a patient whom no network has seen, no element of its mean field inverted.

    widening: how many times it is wider, because patient or plan lies beyond the ranges of the training.
    """
    patient, calibrated = read_patient(model), Calibration.read(calibration)
    interval, repair = repaired_interval(
        patient=patient, displacements=read_ensemble(ensemble), calibration=calibrated, fem=fem
    )
    interval = replace(widened(interval, widening), forces=read_load(ensemble))
    logging.info("%s: mean half-width %.3f mm; %s", case, np.nanmean(interval.half_width), repair)
    about = {"case": case, "method": calibrated.method, "level": calibrated.level}
    interval.write(result, **about, **asdict(of_ensemble(ensemble, repair)))
