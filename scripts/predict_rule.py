"""Makes the predictions of a fold's held-out patients by fixed ratios or by linear regression: their skin alone."""

import time
from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.methods.pca_linear import LinearModel, LinearPredictor
from pinnochio.methods.ratio import RatioRule
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.plans.plan import Plan


def predict_rule(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    linear: str | None,
    threads: int,
    predictions: str,
) -> None:
    """Predict each case by the regression at `linear`, or, without one, by soft-to-hard tissue ratios."""
    regression, found = LinearModel.read(linear) if linear else None, {}
    for case, model, path in zip(cases, models, plans, strict=True):
        patient, plan = PatientModel.read(model), Plan.read(path, case)
        began = time.perf_counter()
        rule = LinearPredictor(regression, patient) if regression else RatioRule(patient)
        set_up = time.perf_counter()
        skin = rule(plan)
        done = time.perf_counter()
        found[case] = Prediction(None, done - set_up, set_up - began, threads, skin=skin)
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_rule(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        plans=snakemake.input.plans,
        linear=snakemake.input.get("linear") or None,
        threads=snakemake.threads,
        predictions=snakemake.output.predictions,
    )
