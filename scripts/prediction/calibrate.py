"""Makes the calibration of a method's interval and its coverage of the errors on held-out patients."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinnochio.columns import write_csv
from pinnochio.logs import attach_log
from pinnochio.metrics.judged import Judged
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import read_prediction
from pinnochio.model.regions import NAMES, regions
from pinnochio.statistics.conformal import coverage, half_widths, held_out
from pinnochio.statistics.intervals import Calibration, read_ensemble, skin_spread, usual_spreads
from pinnochio.tables.coverage import COVERAGE


@dataclass(frozen=True)
class ScannedCase:
    """A patient with a scan: the fold that holds it out, and its files; ensemble: None of a method without networks."""

    case: str
    fold: str
    model: str
    postop: str
    judged: str
    predictions: str
    ensemble: str | None


def calibrate(cases: Sequence[ScannedCase], method: str, level: float, seed: int, calibration: str, table: str) -> None:
    """Write the calibration as JSON and one row per region as CSV.

    predictions: of the fold, which never saw the case; ensemble: of the networks of all folds, for how far they usually
    differ, which nothing is said of without them.
    """
    errors, spreads = [], []
    for files in cases:
        patient = PatientModel.read(files.model)
        scan = PostopSkin.read(files.postop)
        predicted = read_prediction(files.predictions, files.case)
        errors.append(
            held_out(
                case=files.case,
                fold=files.fold,
                patient=patient,
                judged=Judged.read(files.judged),
                moved=predicted.moved_skin(patient),
                points=scan.points,
                faces=scan.faces,
            )
        )
        if files.ensemble:
            spreads.append((skin_spread(patient, read_ensemble(files.ensemble)), regions(patient)))
        logging.info("%s: %.3f mm on %d points", files.case, errors[-1].error.mean(), len(errors[-1].error))
    folds = len({files.fold for files in cases})
    values = Calibration(
        method=method,
        level=level,
        patients=len(cases),
        folds=folds,
        half_width=by_region(half_widths(errors, level)),
        usual_spread=by_region(usual_spreads(spreads) if spreads else np.full(len(NAMES), np.nan)),
    )
    values.write(calibration)
    write_csv(coverage(errors, level, seed).assign(method=method), table, COVERAGE)


def by_region(values: np.ndarray) -> dict[str, float | None]:
    """Values (r,) by the names of the regions; None where there is none."""
    return {name: float(x) if np.isfinite(x) else None for name, x in zip(NAMES, values, strict=True)}


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    columns = {"case": snakemake.params.cases, "fold": snakemake.params.folds}
    columns |= {"model": snakemake.input.models, "postop": snakemake.input.postops, "judged": snakemake.input.judged}
    columns |= {"predictions": snakemake.input.predictions}
    columns |= {"ensemble": snakemake.input.ensembles or [None] * len(snakemake.params.cases)}
    calibrate(
        cases=[ScannedCase(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)],
        method=snakemake.wildcards.method,
        level=snakemake.params.level,
        seed=snakemake.params.seed,
        **dict(snakemake.output.items()),
    )
