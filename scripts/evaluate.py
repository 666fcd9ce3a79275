"""Makes the metrics of a method on a fold's held-out patients."""

import logging
from collections.abc import Sequence

import h5py
import pandas as pd

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.predictions import read_prediction
from pinnochio.evaluation.case import evaluate_case
from pinnochio.evaluation.tables import CASES, write_csv
from pinnochio.logs import attach_log
from pinnochio.mechanics.residual import Operator
from pinnochio.mechanics.simulation import FemSettings


def evaluate(
    cases: Sequence[str],
    predictions: str,
    models: Sequence[str],
    plans: Sequence[str],
    postops: Sequence[str],
    truths: Sequence[str],
    samples: int,
    fem: FemSettings,
    labels: dict,
    seed: int,
    metrics: str,
) -> None:
    """Write one row per case; truths may be empty (no virtual truth); labels are fold, method and code."""
    rows = []
    for number, case in enumerate(cases):
        patient = PatientModel.read(models[number])
        material = fem.material(patient.tissue)
        operator = Operator.build(
            patient.points, patient.cells, material.mu, material.lam, material.stiffening, fem.volumetric
        )
        with h5py.File(postops[number], "r") as file:
            target = file["points"][()], file["faces"][()]
            residual = float(file.attrs["registration_residual"])
        rows.append(
            evaluate_case(
                patient,
                Plan.read(plans[number], case),
                read_prediction(predictions, case),
                operator=operator,
                element=fem.volumetric,
                samples=samples,
                seed=seed,
                target=target,
                truth=read_truth(truths[number]) if truths else None,
                labels=labels | {"registration_residual": residual},
            )
        )
        logging.info("%s: CD %.3f mm", case, rows[-1]["cd"])
    write_csv(pd.DataFrame(rows), metrics, CASES)


def read_truth(path: str):
    """Points, cells and displacement of the simulated outcome, which no method sees."""
    with h5py.File(path, "r") as file:
        return file["points"][()], file["cells"][()], file["displacement"][()]


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    evaluate(
        snakemake.params.cases,
        snakemake.input.predictions,
        snakemake.input.models,
        snakemake.input.plans,
        snakemake.input.postops,
        snakemake.input.get("truths", []),
        snakemake.params.samples,
        FemSettings(**snakemake.params.fem),
        dict(snakemake.wildcards.items()) | {"code": snakemake.params.code},
        snakemake.params.seed,
        snakemake.output.metrics,
    )
