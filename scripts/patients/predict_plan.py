"""Makes all that is handed over of a new patient's plan: the face first, then files and pictures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.patients.model_archive import RANGES, calibration_file
from pinnochio.stages import Stages
from pinnochio.training.device import device_of
from scripts.patients.certify import certify
from scripts.patients.export_prediction import export_prediction
from scripts.patients.show_prediction import show_prediction
from scripts.prediction.predict import predict
from scripts.prediction.predict_interval import predict_interval, show_interval


def predict_plan(
    about: Mapping,
    planned: Mapping[str, str],
    quality: str,
    fem: FemSettings,
    method: Mapping[str, object],
    networks: Mapping[str, str],
    lifts: Sequence[str],
    covariates: Sequence[str],
    archive: str | None,
    outputs: Mapping[str, str],
) -> None:
    """Run the stages one after another: prediction (with its interval, of networks), certificate, page, files.

    about: as :func:`~scripts.patients.certify.certify` takes it; planned: files model and plan; method: predictor, its
    settings, device and threads; networks: file by fold, none of a method that learns nothing; archive: folder of
    the networks' archive; outputs: files result, certificate, measures, page, mesh, and of
    networks ensemble and picture.
    """
    case, result = about["case"], outputs["result"]
    named = {"case": case}
    with Stages(Path(result).with_name(".predict_plan.json")) as stages:
        read = {"models": [planned["model"]], "plans": [planned["plan"]], "trained": list(networks.values())}
        read |= {"lifts": lifts, "truths": [], "covariates": covariates}
        made = {"predictions": outputs["ensemble"] if networks else result}
        stages(predict, read, made, {"names": list(networks) or [case], "cases": [case], "warm": False, **method})
        if networks:
            read = {**planned, "ensemble": outputs["ensemble"], "quality": quality}
            calibration = str(Path(archive) / calibration_file(about["method"]))
            read |= {"calibration": calibration, "ranges": str(Path(archive) / RANGES)}
            stages(predict_interval, read, {"result": result}, {**named, "fem": fem})
        read = {**planned, "quality": quality, "result": result, "folder": archive}
        certificate = {"certificate": outputs["certificate"]}
        stages(certify, read, certificate, {"about": about, "fem": fem})
        shown = {name: outputs[name] for name in ("measures", "page")}
        stages(show_prediction, {**planned, **certificate, "result": result}, shown, named)
        export_prediction(case=case, **planned, result=result, folder=str(Path(outputs["mesh"]).parent))
        if networks:
            read = {"model": planned["model"], "result": result, "calibration": calibration}
            stages(show_interval, read, {"picture": outputs["picture"]}, named)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files, params, named = snakemake.input, snakemake.params, dict(snakemake.wildcards.items())
    device = device_of(params.predictor, snakemake.resources.gpu, snakemake.threads)
    method = {"predictor": params.predictor, "settings": params.settings, "device": device}
    predict_plan(
        about=named
        | {"plan": named["plan"].removeprefix("/"), "code": params.predicts, "corrections": params.corrections},
        planned={"model": files.model, "plan": files.plan},
        quality=files.quality,
        fem=FemSettings(**params.fem),
        method=method | {"threads": snakemake.threads},
        networks=dict(zip(params.folds, files.networks, strict=True)),
        lifts=files.lifts,
        covariates=files.covariates,
        archive=params.archive,
        outputs=dict(snakemake.output.items()),
    )
