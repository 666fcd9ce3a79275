"""Makes all that is handed over of a new patient's plan: the face first, then files and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from pinnochio.beside import beside
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.solvers.inversion_repair import Repair
from pinnochio.metrics.validity import OFF_BONE
from pinnochio.patients.certificate import astray, in_distribution
from pinnochio.patients.front import within
from pinnochio.patients.in_distribution import Ranges, out_of_range, widening
from pinnochio.patients.model_archive import FALLBACK, RANGES, calibration_file
from pinnochio.patients.result import of_ensemble, read_patient
from pinnochio.plans.plan import Plan
from pinnochio.stages import Stages
from pinnochio.statistics.intervals import read_ensemble
from pinnochio.training.device import device_of

PREDICT, CERTIFY = "scripts.prediction.predict:predict", "scripts.patients.certify:certify"
DRAW, SHOW = "scripts.patients.show_prediction:draw", "scripts.patients.show_prediction:show_prediction"
UNLIKE = "patient or plan is unlike those of the training of"
TORN = "tissue is folded or taken off its bone by"
INTERVAL = "scripts.prediction.predict_interval:predict_interval"
EXPORT = "scripts.patients.export_prediction:export_prediction"


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
    others: Mapping[str, Mapping],
    outputs: Mapping[str, str | Sequence[str]],
    seconds: float | None = None,
) -> None:
    """Run the stages: prediction (with its interval, of networks), certificate; beside them pictures, page and files.

    Finite elements predict in the networks' place, where the archive says how near these come, a patient or plan out of
    the training's range, and one whose tissue the networks tear.

    about: as :func:`~scripts.patients.certify.certify` takes it; planned: files model and plan; method: predictor, its
    settings, device and threads; networks: file by fold, none of a method that learns nothing; archive: folder of the
    networks' archive; others: predictor and settings, by method, of FALLBACK and what `seconds` of a plan, where they
    are limited, are chosen among, which is said first; outputs: files result, certificate, measures, page, mesh and
    skin (several), folder bones, and of networks ensemble.
    """
    case, result = about["case"], outputs["result"]
    named, calibrated = {"case": case}, {}
    if seconds:
        best = within(seconds, read_patient(planned["model"]), Plan.read(planned["plan"], case), fem)
        print(best.words, flush=True)
        fem = replace(fem, accuracy=best.accuracy or fem.accuracy)
        method = {**method, **others[best.method]}
        method["settings"] = {**method["settings"], "fem": asdict(fem)}
        about = dict(about) | {"method": best.method, "expected_mm": best.mm}
    compared = compare(case, **planned, quality=quality, ranges=str(Path(archive) / RANGES)) if archive else None
    first = {"names": list(networks) or [case], "trained": list(networks.values()), "lifts": lifts}
    first |= {"covariates": covariates, **method}
    other = {"names": [FALLBACK], "trained": [], "lifts": [], "covariates": [], **method, **others.get(FALLBACK, {})}
    instead = dict(about) | {"method": FALLBACK, "instead_of": about["method"], "corrections": 0}
    able = bool(networks) and (Path(archive) / calibration_file(FALLBACK)).is_file()
    if able and out_of_range(compared):
        able, first, about = False, other, instead | {"because": UNLIKE}
    drawn = [str(Path(result).with_name(f".{name}.json")) for name in ("bones", "faces")]
    begin = partial(beside().submit, Stages(Path(result).with_name(".beside.json")))
    begun = [begin(DRAW, planned, {"pictures": drawn[0]}, named)]
    with Stages(Path(result).with_name(".predict_plan.json")) as stages:
        ensemble = outputs["ensemble"] if archive else result

        def field(by: Mapping, file: str) -> None:
            settings = {"cases": [case], "warm": False, **by}
            read = {key: settings.pop(key) for key in ("trained", "lifts", "covariates")}
            read |= {"models": [planned["model"]], "plans": [[planned["plan"]]], "truths": []}
            stages(PREDICT, read, {"predictions": [file]}, settings)

        field(first, ensemble)
        if able and torn(case, ensemble, **planned):
            about, ensemble = instead | {"because": TORN}, str(Path(result).with_name(".instead.h5"))
            field(other, ensemble)
        if archive:
            calibrated = {"calibration": str(Path(archive) / calibration_file(about["method"]))}
            read = {"model": planned["model"], "ensemble": ensemble, **calibrated}
            stages(INTERVAL, read, {"result": result}, {**named, "fem": fem, "widening": widening(compared)})
        read = {**planned, "result": result}
        begun.append(begin(DRAW, read, {"pictures": drawn[1]}, named))
        certificate = {"certificate": outputs["certificate"]}
        settings = {"about": about, "fem": fem, "compared": compared}
        stages(CERTIFY, {**read, "quality": quality, "folder": archive}, certificate, settings)
        made = {name: outputs[name] for name in ("measures", "page")}
        begun.append(begin(SHOW, {**read, **certificate, **calibrated, "drawn": drawn}, made, named))
        begun.append(begin(EXPORT, read, {name: outputs[name] for name in ("mesh", "skin", "bones")}, named))
        for each in begun:
            each.result()


def torn(case: str, ensemble: str, model: str, plan: str) -> bool:
    """Whether a field was scaled to keep its elements upright, or the mean one takes tissue off its bone."""
    damping = of_ensemble(ensemble, Repair(raw_least=1.0, raw_inverted=0, least=1.0)).damping
    away = astray(read_patient(model), Plan.read(plan, case), read_ensemble(ensemble).mean(axis=0))
    return damping < 1 or away > OFF_BONE


def compare(case: str, model: str, plan: str, quality: str, ranges: str) -> dict:
    """How patient and plan lie to those of the training, as :func:`in_distribution` says it."""
    return in_distribution(read_patient(model), Plan.read(plan, case), read_stored_json(quality), Ranges.read(ranges))


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
        others=params.others,
        seconds=params.seconds,
        # One file per bone of the patient, which its segmentation tells.
        outputs=dict(snakemake.output.items()) | {"bones": str(Path(snakemake.output.mesh).with_name("bones"))},
    )
