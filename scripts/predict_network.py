"""Makes a trained network's predictions of a fold's held-out patients."""

import logging
from collections.abc import Sequence

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.predictions import Prediction, write_predictions
from pinnochio.logs import attach_log
from pinnochio.mechanics.lift import Lift
from pinnochio.mechanics.refine import Finish
from pinnochio.mechanics.settings import FemSettings
from pinnochio.training.checkpoint import load_network
from pinnochio.training.device import choose_device
from pinnochio.training.stages import predict_case


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
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.get("lifts", []),
        snakemake.input.plans,
        snakemake.input.network,
        FemSettings(**snakemake.params.fem),
        snakemake.params.refine,
        choose_device(snakemake.resources.gpu, snakemake.threads),
        snakemake.threads,
        snakemake.output.predictions,
    )
