"""Makes the finite-element predictions of a fold's held-out patients."""

import logging
from collections.abc import Sequence
from dataclasses import replace

from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import simulate
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions
from pinnochio.plans.plan import Plan


def predict_fem(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    arm: str,
    settings: FemSettings,
    threads: int,
    predictions: str,
    apart: float = 0.0,
) -> None:
    """Solve each case's plan; a solve that stops early is written as such, with the last good state.

    apart in mm: as in boundary_conditions.

    The first case is begun once more beforehand, so that no timing holds the loading of compiled code.
    """
    patients = [PatientModel.read(model) for model in models]
    motions = [Plan.read(plan, case) for plan, case in zip(plans, cases, strict=True)]
    simulate(patients[0], motions[0], arm, replace(settings, time_limit=1e-3), apart)
    found = {}
    for case, patient, plan in zip(cases, patients, motions, strict=True):
        result = simulate(patient, plan, arm, settings, apart)
        logging.info("%s: %s, %.1f s", case, result.reason, result.seconds)
        found[case] = Prediction(
            result.displacement,
            seconds=result.seconds,
            threads=threads,
            converged=result.converged,
            reason=result.reason,
            iterations=result.iterations,
        )
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_fem(
        cases=snakemake.params.cases,
        models=snakemake.input.models,
        plans=snakemake.input.plans,
        arm=snakemake.params.arm,
        settings=FemSettings(**snakemake.params.fem),
        threads=snakemake.threads,
        predictions=snakemake.output.predictions,
        apart=snakemake.params.apart,
    )
