"""Makes the picture of one patient: before, plan, outcome, and every method with its error."""

from collections.abc import Mapping

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.postop import PostopSkin
from pinnochio.anatomy.predictions import read_prediction
from pinnochio.evaluation.distances import signed_distances
from pinnochio.evaluation.pictures import case_picture, surface_of
from pinnochio.logs import attach_log


def render_case(
    case: str, models: Mapping[str, str], plan: str, postop: str, predictions: Mapping[str, str], picture: str
) -> None:
    """Draw the case; models and predictions map each method to the model it predicts on and to the file of its fold."""
    read = {path: PatientModel.read(path) for path in set(models.values())}
    patients = {method: read[path] for method, path in models.items()}
    target = PostopSkin.read(postop).surface
    skins = {
        method: surface_of(read_prediction(path, case).moved_skin(patients[method]), patients[method].skin_faces)
        for method, path in predictions.items()
    }
    errors = {method: signed_distances(skin.points, *target) for method, skin in skins.items()}
    case_picture(next(iter(patients.values())), Plan.read(plan, case), target, skins, errors, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_case(
        snakemake.wildcards.case,
        dict(zip(snakemake.params.methods, snakemake.input.models, strict=True)),
        snakemake.input.plan,
        snakemake.input.postop,
        dict(zip(snakemake.params.methods, snakemake.input.predictions, strict=True)),
        snakemake.output.picture,
    )
