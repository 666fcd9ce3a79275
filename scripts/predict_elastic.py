"""Makes the predictions of a fold's held-out patients by linear elasticity, factorised once per patient."""

import logging
import time
from collections.abc import Sequence

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.predictions import Prediction, write_predictions
from pinnochio.logs import attach_log
from pinnochio.mechanics.elastic import ElasticSolver
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.sliding import boundary_conditions


def predict_elastic(
    cases: Sequence[str],
    models: Sequence[str],
    plans: Sequence[str],
    fem: FemSettings,
    threads: int,
    predictions: str,
) -> None:
    """Solve each case's plan with sliding interfaces, warm; a linear field may hold inverted elements."""
    found = {}
    for case, model, path in zip(cases, models, plans, strict=True):
        patient = PatientModel.read(model)
        boundary = boundary_conditions(patient, Plan.read(path, case), "mucosa")
        began = time.perf_counter()
        material = fem.material(patient.tissue)
        solver = ElasticSolver(patient.points, patient.cells, material, boundary, fem.volumetric, fem.linear_solver)
        solver.solve(boundary)
        set_up = time.perf_counter()
        displacement = solver.solve(boundary)
        done = time.perf_counter()
        solver.close()
        logging.info("%s: %.4f s, and %.2f s for the patient", case, done - set_up, set_up - began)
        found[case] = Prediction(displacement, done - set_up, set_up - began, threads)
    write_predictions(predictions, found)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_elastic(
        snakemake.params.cases,
        snakemake.input.models,
        snakemake.input.plans,
        FemSettings(**snakemake.params.fem),
        snakemake.threads,
        snakemake.output.predictions,
    )
