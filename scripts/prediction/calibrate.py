"""Makes the calibration of a method's interval and its coverage of the errors on held-out patients."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pinnochio.columns import write_csv
from pinnochio.logs import attach_log
from pinnochio.metrics.judged import Judged
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import read_prediction
from pinnochio.model.regions import NAMES, regions
from pinnochio.model.truth import TrueMotion
from pinnochio.statistics.conformal import ALL, coverage, half_widths, held_out, measures_held_out
from pinnochio.statistics.intervals import Calibration, read_ensemble, skin_spread, usual_spreads
from pinnochio.tables.coverage import COVERAGE


@dataclass(frozen=True)
class ScannedCase:
    """A patient with a scan: the fold that holds it out, and its files; ensemble: None of a method without networks;
    truth: none of a patient of a clinic."""

    case: str
    fold: str
    model: str
    postop: str
    judged: str
    predictions: str
    ensemble: str | None
    truth: str | None = None


def calibrate(cases: Sequence[ScannedCase], method: str, level: float, seed: int, calibration: str, table: str) -> None:
    """Write the calibration as JSON and one row per region and measure as CSV; measures of fields alone.

    predictions: of the fold, which never saw the case, by the motion that a user predicts from; ensemble: of the
    networks of all folds, for how far they usually differ, which nothing is said of without them.
    """
    errors, measured, spreads = [], [], []
    for files in cases:
        patient = PatientModel.read(files.model)
        scan = PostopSkin.read(files.postop)
        predicted = read_prediction(files.predictions, files.case)
        judged, moved = Judged.read(files.judged), predicted.moved_skin(patient)
        errors.append(held_out(files.case, files.fold, patient, judged, moved, *scan.surface))
        if predicted.displacement is not None:  # a method of the skin alone carries no landmark
            truth = TrueMotion.read(files.truth, patient, files.case) if files.truth else None
            measured.append(measures_held_out(files.case, files.fold, patient, predicted.displacement, scan, truth))
        if files.ensemble:
            spreads.append((skin_spread(patient, read_ensemble(files.ensemble)), regions(patient)))
        logging.info("%s: %.3f mm on %d points", files.case, errors[-1].error.mean(), len(errors[-1].error))
    folds = len({files.fold for files in cases})
    values = Calibration(
        method=method,
        level=level,
        patients=len(cases),
        folds=folds,
        half_width=by_name(NAMES, half_widths(errors, level)),
        usual_spread=by_name(NAMES, usual_spreads(spreads) if spreads else np.full(len(NAMES), np.nan)),
        measures=by_name(MEASURES, half_widths(measured, level, MEASURES)),
    )
    values.write(calibration)
    units = {name: one.unit for name, one in MEASURES.items()}
    rows = pd.concat([coverage(errors, level, seed), coverage(measured, level, seed, units, ALL)])
    write_csv(rows.assign(method=method), table, COVERAGE)


def by_name(names: Iterable[str], values: np.ndarray) -> dict[str, float | None]:
    """Values (r,) by their names; None where there is none."""
    return {name: float(x) if np.isfinite(x) else None for name, x in zip(names, values, strict=True)}


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    columns = {"case": snakemake.params.cases, "fold": snakemake.params.folds}
    columns |= {"model": snakemake.input.models, "postop": snakemake.input.postops, "judged": snakemake.input.judged}
    columns |= {"predictions": snakemake.input.predictions}
    nothing = [None] * len(snakemake.params.cases)
    columns |= {"ensemble": snakemake.input.ensembles or nothing, "truth": snakemake.input.truths or nothing}
    calibrate(
        cases=[ScannedCase(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)],
        method=snakemake.wildcards.method,
        level=snakemake.params.level,
        seed=snakemake.params.seed,
        **dict(snakemake.output.items()),
    )
