"""Makes the predictions of a fold's held-out patients by linear elasticity, factorised once per patient."""

import logging
from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate_elastic
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.plans.plan import Plan


def predict_elastic(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    fem: FemSettings,
    threads: int,
    predictions: str,
) -> None:
    """Solve each case's plan, warm, as simulate_elastic does."""
    found = {}
    for case, model, path in zip(cases, models, plans, strict=True):
        patient = PatientModel.read(model)
        displacement, seconds, setup = simulate_elastic(patient, Plan.read(path, case), fem)
        logging.info("%s: %.4f s, and %.2f s for the patient", case, seconds, setup)
        found[case] = Prediction(displacement, seconds, setup, threads)
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_elastic(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        plans=snakemake.input.plans,
        fem=FemSettings(**snakemake.params.fem),
        threads=snakemake.threads,
        predictions=snakemake.output.predictions,
    )
