"""Makes the trade-off's rows of the methods as the study predicted by them, on one patient."""

from collections.abc import Mapping

import pandas as pd

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.postop import PostopSkin
from pinnochio.anatomy.predictions import read_prediction
from pinnochio.evaluation.tables import write_csv
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.tradeoff.dials import as_in_the_study
from pinnochio.tradeoff.measure import Reference, judge
from pinnochio.tradeoff.table import TRADEOFF_CASES


def measure_study(
    case: str,
    predictions: Mapping[str, str],
    models: Mapping[str, str],
    postop: str,
    reference: str,
    reference_model: str,
    fem: FemSettings,
    samples: int,
    seed: int,
    rows: str,
) -> None:
    """Write one row per method; predictions, models: file by method."""
    judged = Reference(PatientModel.read(reference_model), read_prediction(reference, case).displacement)
    target, found = PostopSkin.read(postop).surface, []
    for method, path in predictions.items():
        patient, prediction = PatientModel.read(models[method]), read_prediction(path, case)
        setting = as_in_the_study(method, len(patient.points))
        found.append(judge(setting, case, patient, prediction, target, judged, fem, samples, seed))
    write_csv(pd.DataFrame(found), rows, TRADEOFF_CASES)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_study(
        snakemake.wildcards.case,
        dict(zip(snakemake.params.methods, snakemake.input.predictions, strict=True)),
        dict(zip(snakemake.params.methods, snakemake.input.models, strict=True)),
        snakemake.input.postop,
        snakemake.input.reference,
        snakemake.input.reference_model,
        FemSettings(**snakemake.params.fem),
        snakemake.params.samples,
        snakemake.params.seed,
        snakemake.output.rows,
    )
