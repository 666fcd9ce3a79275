"""Makes the predictions of one patient by every fold's network of a method."""

import logging
from collections.abc import Mapping

from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.mechanics.lift import Lift
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import write_predictions
from pinnochio.plans.plan import Plan
from pinnochio.references import resolve
from pinnochio.training.device import choose_device


def predict_ensemble(
    predictor: str,
    settings: Mapping,
    networks: Mapping[str, str],
    case: str,
    model: str,
    plan: str,
    lift: str | None,
    covariates: str | None,
    device: str,
    threads: int,
    ensemble: str,
) -> None:
    """Write one group per fold, in the form of predictions; FloatingPointError if a field is not finite.

    settings: values of the sections that the `predictor` reads; networks: file by fold; lift: file of the
    patient's lift, None for networks without one; covariates: file of what else is known, None where nothing reads it.
    """
    planned = Planned(
        case=case,
        patient=PatientModel.read(model),
        plan=Plan.read(plan, case),
        lift=Lift.read(lift) if lift else None,
        covariates=read_stored_json(covariates) if covariates else {},
    )
    method, made = resolve(predictor), {}
    for fold, network in networks.items():
        made[fold] = method(settings=settings, trained=network, device=device, threads=threads)(planned)
        logging.info("%s by fold %s: %.3f s", case, fold, made[fold].seconds)
    write_predictions(ensemble, made)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_ensemble(
        predictor=snakemake.params.predictor,
        settings=snakemake.params.settings,
        networks=dict(zip(snakemake.params.folds, snakemake.input.networks, strict=True)),
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        plan=snakemake.input.plan,
        lift=next(iter(snakemake.input.get("lifts", [])), None),
        covariates=next(iter(snakemake.input.get("covariates", [])), None),
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        ensemble=snakemake.output.ensemble,
    )
