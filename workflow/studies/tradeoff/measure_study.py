"""Makes the trade-off's rows of the methods as the study predicted by them, on one patient."""

from collections.abc import Mapping

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.judged import Judged
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import read_prediction
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.measuring import Reference, judge
from studies.tradeoff.settings import BASE, Setting


def measure_study(
    case: str,
    predictions: Mapping[str, str],
    models: Mapping[str, str],
    postop: str,
    judged: str,
    reference: str,
    reference_model: str,
    fem: FemSettings,
    rows: str,
) -> None:
    """Write one row per method; predictions, models: file by method."""
    solution = Reference.of(PatientModel.read(reference_model), read_prediction(reference, case))
    target, samples, judgements = PostopSkin.read(postop).surface, Judged.read(judged), []
    for method, path in predictions.items():
        patient, prediction = PatientModel.read(models[method]), read_prediction(path, case)
        setting = Setting(method, "none", BASE, len(patient.points))
        judgements.append(judge(setting, case, patient, prediction, target, samples, solution, fem))
    write_rows(judgements, rows, TRADEOFF_CASES)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_study(
        case=snakemake.wildcards.case,
        predictions=dict(zip(snakemake.params.methods, snakemake.input.predictions, strict=True)),
        models=dict(zip(snakemake.params.methods, snakemake.input.models, strict=True)),
        **{name: snakemake.input[name] for name in ("postop", "judged", "reference", "reference_model")},
        fem=FemSettings(**snakemake.params.fem),
        rows=snakemake.output.rows,
    )
