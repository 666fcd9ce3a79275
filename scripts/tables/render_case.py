"""Makes the picture of one patient: before, plan, outcome, and every method with its error; and the same in 3D."""

import json
from collections.abc import Mapping

import numpy as np

from pinnochio.figures.patient import case_picture, surface_of
from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import read_prediction
from pinnochio.plans.plan import Plan
from pinnochio.report.skin_view import judged_errors, make_view


def render_case(
    case: str,
    models: Mapping[str, str],
    plan: str,
    postop: str,
    predictions: Mapping[str, str],
    picture: str,
    view: str,
) -> None:
    """Draw the case (PNG), and write what a page shows of it in 3D (JSON).

    models and predictions map each method to the model it predicts on and to the file of its fold. A prediction that
    is not finite is left out.
    """
    read = {path: PatientModel.read(path) for path in set(models.values())}
    patients = {method: read[path] for method, path in models.items()}
    moved = {method: read_prediction(path, case).moved_skin(patients[method]) for method, path in predictions.items()}
    moved = {method: points for method, points in moved.items() if np.isfinite(points).all()}
    planned, target = Plan.read(plan, case), PostopSkin.read(postop).surface
    errors = {method: judged_errors(patients[method], points, target) for method, points in moved.items()}
    skins = {method: surface_of(points, patients[method].skin_faces) for method, points in moved.items()}
    case_picture(
        patient=next(iter(patients.values())), plan=planned, target=target, skins=skins, errors=errors, path=picture
    )
    with replacing(view) as temporary:
        temporary.write_text(
            json.dumps(make_view(patients=patients, plan=planned, target=target, moved=moved, errors=errors)),
            encoding="utf-8",
        )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_case(
        case=snakemake.wildcards.case,
        models=dict(zip(snakemake.params.methods, snakemake.input.models, strict=True)),
        plan=snakemake.input.plan,
        postop=snakemake.input.postop,
        predictions=dict(zip(snakemake.params.methods, snakemake.input.predictions, strict=True)),
        **dict(snakemake.output.items()),
    )
