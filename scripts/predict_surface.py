"""Makes a trained surface network's predictions of a fold's held-out patients: their skin alone."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.methods.surface.learner import load_surface_network, predict_case
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.plans.plan import Plan
from pinnochio.training.device import choose_device


def predict_surface(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    network: str,
    device: str,
    threads: int,
    predictions: str,
) -> None:
    """Predict each case, warm; FloatingPointError if a field is not finite."""
    trained, settings = load_surface_network(network, device)
    found = {}
    for case, model, plan in zip(cases, models, plans, strict=True):
        patient = PatientModel.read(model)
        skin, seconds, setup = predict_case(trained, settings, patient, Plan.read(plan, case), device)
        found[case] = Prediction(None, seconds, setup, threads, device, skin=skin)
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_surface(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        plans=snakemake.input.plans,
        network=snakemake.input.network,
        device=choose_device(snakemake.resources.gpu, snakemake.threads),
        threads=snakemake.threads,
        predictions=snakemake.output.predictions,
    )
