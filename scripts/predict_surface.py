"""Makes a trained surface network's predictions of a fold's held-out patients: their skin alone."""

from collections.abc import Sequence

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.predictions import Prediction, write_predictions
from pinnochio.baselines.stages import load_surface_network, predict_case
from pinnochio.logs import attach_log
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
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.plans,
        snakemake.input.network,
        choose_device(snakemake.resources.gpu, snakemake.threads),
        snakemake.threads,
        snakemake.output.predictions,
    )
