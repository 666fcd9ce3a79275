"""Makes a trained network's predictions of a fold's held-out patients."""

import logging
from collections.abc import Sequence

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


def predict_network(
    cases: Sequence[str],
    models: Sequence[str],
    lifts: Sequence[str],
    plans: Sequence[str],
    network: str,
    fem: FemSettings,
    corrections: int,
    device: str,
    threads: int,
    predictions: str,
) -> None:
    """Predict each case, warm; FloatingPointError if a field is not finite.

    lifts may be empty for a network without one. No field is written with an inverted element, and each after so many
    Newton corrections; both are timed with the network.
    """
    model, settings = load_network(network, device)
    found = {}
    for case, path, lift, plan in zip(cases, models, lifts or [None] * len(cases), plans, strict=True):
        patient = PatientModel.read(path)
        finish = Finish(patient, fem, corrections)
        (displacement, boundary, repair, made), seconds, setup = predict_case(
            model, settings, fem, patient, Plan.read(plan, case), device, Lift.read(lift) if lift else None, finish
        )
        finish.close()
        logging.info("%s: %.3f s, and %.3f s for the patient; %s", case, seconds, setup, repair)
        found[case] = Prediction(
            displacement,
            seconds,
            setup,
            threads,
            device,
            iterations=made,
            boundary=boundary,
            raw_min_jacobian=repair.raw_least,
            raw_inverted=repair.raw_inverted,
            repaired=repair.elements,
            damping=repair.damping,
        )
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_network(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        lifts=snakemake.input.get("lifts", []),
        plans=snakemake.input.plans,
        network=snakemake.input.network,
        fem=FemSettings(**snakemake.params.fem),
        corrections=snakemake.params.corrections,
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        predictions=snakemake.output.predictions,
    )
