"""Makes a trained network's predictions of a fold's held-out patients."""

import logging
from collections.abc import Sequence

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.predictions import Prediction, write_predictions
from pinnochio.logs import attach_log
from pinnochio.mechanics.simulation import FemSettings
from pinnochio.training.checkpoint import load_network
from pinnochio.training.device import choose_device
from pinnochio.training.stages import predict_case


def predict_network(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    network: str,
    fem: FemSettings,
    device: str,
    threads: int,
    predictions: str,
) -> None:
    """Predict each case, warm; FloatingPointError if a field is not finite."""
    model, settings = load_network(network, device)
    found = {}
    for case, path, plan in zip(cases, models, plans, strict=True):
        displacement, seconds, setup = predict_case(
            model, settings, fem, PatientModel.read(path), Plan.read(plan, case), device
        )
        logging.info("%s: %.3f s, and %.3f s for the patient", case, seconds, setup)
        found[case] = Prediction(displacement, seconds, setup, threads, device)
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_network(
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.plans,
        snakemake.input.network,
        FemSettings(**snakemake.params.fem),
        choose_device(snakemake.resources.gpu, snakemake.threads),
        snakemake.threads,
        snakemake.output.predictions,
    )
