"""Makes the metrics of a method on a fold's held-out patients."""

import logging
from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio.anatomy.model import PatientModel
from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.postop import PostopSkin
from pinnochio.anatomy.predictions import read_prediction
from pinnochio.evaluation.case import evaluate_case
from pinnochio.evaluation.tables import CASES, write_csv
from pinnochio.evaluation.volume_error import read_truth
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings


def evaluate(
    cases: Sequence[str],
    predictions: str,
    models: Sequence[str],
    plans: Sequence[str],
    postops: Mapping[str, str],
    truths: Sequence[str],
    samples: int,
    fem: FemSettings,
    labels: dict,
    seed: int,
    metrics: str,
) -> None:
    """Write one row per case; labels are fold, method and code.

    postops: file by case of those that have a scan, the others get no accuracy; truths may be empty (no virtual truth).
    """
    rows = []
    for number, case in enumerate(cases):
        patient = PatientModel.read(models[number])
        skin = PostopSkin.read(postops[case]) if case in postops else None
        rows.append(
            evaluate_case(
                patient,
                Plan.read(plans[number], case),
                read_prediction(predictions, case),
                fem=fem,
                samples=samples,
                seed=seed,
                target=skin and skin.surface,
                truth=read_truth(truths[number], case)[:3] if truths else None,
                labels=labels | ({"registration_residual": skin.residual} if skin else {}),
            )
        )
        logging.info("%s: CD %.3f mm, min J %.3f", case, rows[-1]["cd"], rows[-1]["min_jacobian"])
    write_csv(pd.DataFrame(rows), metrics, CASES)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    evaluate(
        snakemake.params.cases,
        snakemake.input.predictions,
        snakemake.input.models,
        snakemake.input.plans,
        dict(zip(snakemake.params.scanned, snakemake.input.get("postops", []), strict=True)),
        snakemake.input.get("truths", []),
        snakemake.params.samples,
        FemSettings(**snakemake.params.fem),
        {name: snakemake.wildcards[name] for name in ("fold", "method")} | {"code": snakemake.params.code},
        snakemake.params.seed,
        snakemake.output.metrics,
    )
