"""Makes the prediction of a new patient with its calibrated interval, and a picture of how far off it may be."""

import logging

import numpy as np

from pinnochio.figures.interval import interval_picture
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.statistics.intervals import Calibration, read_ensemble, repaired_interval


def predict_interval(
    case: str, model: str, ensemble: str, calibration: str, fem: FemSettings, result: str, picture: str
) -> None:
    """Write the interval of a patient whom no network has seen, no element of its mean field inverted."""
    patient, calibrated = PatientModel.read(model), Calibration.read(calibration)
    interval, repair = repaired_interval(
        patient=patient, displacements=read_ensemble(ensemble), calibration=calibrated, fem=fem
    )
    logging.info("%s: mean half-width %.3f mm; %s", case, np.nanmean(interval.half_width), repair)
    interval.write(result, case=case, method=calibrated.method, level=calibrated.level)
    interval_picture(patient=patient, interval=interval, calibration=calibrated, case=case, path=picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_interval(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        ensemble=snakemake.input.ensemble,
        calibration=snakemake.input.calibration,
        fem=FemSettings(**snakemake.params.fem),
        result=snakemake.output.interval,
        picture=snakemake.output.picture,
    )
