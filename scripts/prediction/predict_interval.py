"""Makes the prediction of a new patient with its calibrated interval."""

import logging
from dataclasses import asdict, replace

import numpy as np

from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import in_distribution
from pinnochio.patients.in_distribution import Ranges, widening
from pinnochio.patients.result import of_ensemble
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration, read_ensemble, read_load, repaired_interval, widened


def predict_interval(
    case: str,
    model: str,
    plan: str,
    quality: str,
    ensemble: str,
    calibration: str,
    ranges: str,
    fem: FemSettings,
    result: str,
) -> None:
    """Write the interval of a patient whom no network has seen, no element of its mean field inverted.

    It is wider where patient or plan lies beyond the ranges of the training.
    """
    patient, calibrated = PatientModel.read(model), Calibration.read(calibration)
    interval, repair = repaired_interval(
        patient=patient, displacements=read_ensemble(ensemble), calibration=calibrated, fem=fem
    )
    compared = in_distribution(
        patient=patient, plan=Plan.read(plan, case), quality=read_stored_json(quality), ranges=Ranges.read(ranges)
    )
    interval = replace(widened(interval, widening(compared)), forces=read_load(ensemble))
    logging.info("%s: mean half-width %.3f mm; %s", case, np.nanmean(interval.half_width), repair)
    about = {"case": case, "method": calibrated.method, "level": calibrated.level}
    interval.write(result, **about, **asdict(of_ensemble(ensemble, repair)))
