"""Makes the predictions of one patient by every fold's network of a method."""

import logging
from collections.abc import Mapping

from pinnochio.logs import attach_log
from pinnochio.mechanics.corrections import Finish
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.learner import predict_case
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.plans.plan import Plan
from pinnochio.training.checkpoint import load_network
from pinnochio.training.device import choose_device


def predict_ensemble(
    case: str,
    model: str,
    plan: str,
    lift: str | None,
    networks: Mapping[str, str],
    fem: FemSettings,
    corrections: int,
    device: str,
    threads: int,
    ensemble: str,
) -> None:
    """Write one group per fold, in the form of predictions; FloatingPointError if a field is not finite.

    Each field is finished as the held-out ones are, by so many Newton corrections and without inverted elements;
    networks: file by fold; lift: file of the patient's lift, None for networks without one.
    """
    patient, planned = PatientModel.read(model), Plan.read(plan, case)
    lifted = Lift.read(lift) if lift else None
    finish = Finish(patient, fem, corrections)
    found = {}
    for fold, path in networks.items():
        network, settings = load_network(path, device)
        (displacement, _, repair, made), seconds, setup = predict_case(
            network, settings, fem, patient, planned, device, lifted, finish
        )
        logging.info("%s by fold %s: %.3f s; %s", case, fold, seconds, repair)
        found[fold] = Prediction(displacement, seconds, setup, threads, device, iterations=made)
    finish.close()
    write_predictions(ensemble, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_ensemble(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        plan=snakemake.input.plan,
        lift=next(iter(snakemake.input.get("lifts", [])), None),
        networks=dict(zip(snakemake.params.folds, snakemake.input.networks, strict=True)),
        fem=FemSettings(**snakemake.params.fem),
        corrections=snakemake.params.corrections,
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        ensemble=snakemake.output.ensemble,
    )
