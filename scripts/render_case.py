"""Makes the picture of one patient: before, plan, outcome, and every method with its error."""

from collections.abc import Mapping

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.postop import PostopSkin
from pinnochio.anatomy.predictions import read_prediction
from pinnochio.evaluation.distances import signed_distances
from pinnochio.evaluation.pictures import case_picture
from pinnochio.logs import attach_log


def render_case(case: str, model: str, plan: str, postop: str, predictions: Mapping[str, str], picture: str) -> None:
    """Draw the case; predictions maps each method to the file that holds the case."""
    patient = PatientModel.read(model)
    target = PostopSkin.read(postop).surface
    fields = {method: read_prediction(path, case).displacement for method, path in predictions.items()}
    errors = {method: signed_distances(patient.moved_skin(field), *target) for method, field in fields.items()}
    case_picture(patient, Plan.read(plan, case), target, fields, errors, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_case(
        snakemake.wildcards.case,
        snakemake.input.model,
        snakemake.input.plan,
        snakemake.input.postop,
        dict(zip(snakemake.params.methods, snakemake.input.predictions, strict=True)),
        snakemake.output.picture,
    )
