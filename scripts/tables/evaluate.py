"""Makes the metrics of a method on a fold's held-out patients."""

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from pinnochio.columns import write_rows
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.evaluation import evaluate_case
from pinnochio.metrics.judged import Judged
from pinnochio.metrics.worst_point import compared, write_skins
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import read_prediction
from pinnochio.model.truth import TrueMotion
from pinnochio.plans.plan import Plan


def evaluate(
    cases: Sequence[str],
    predictions: str,
    models: Sequence[str],
    plans: Sequence[str],
    postops: Mapping[str, str],
    judged: Mapping[str, str],
    truths: Sequence[str],
    fem: FemSettings,
    labels: dict,
    seed: int,
    metrics: str,
    skins: str | None = None,
) -> None:
    """Write one row per case, and where the judged skin goes (skins); labels are fold, method and code.

    postops, judged: files by case of those that have a scan, the others get no accuracy; truths may be empty (no
    virtual truth).
    """
    rows, moved = [], {}
    for number, case in enumerate(cases):
        patient = PatientModel.read(models[number])
        skin = PostopSkin.read(postops[case]) if case in postops else None
        samples, prediction = skin and Judged.read(judged[case]), read_prediction(predictions, case)
        rows.append(
            evaluate_case(
                patient,
                Plan.read(plans[number], case),
                prediction,
                fem=fem,
                seed=seed,
                target=skin and skin.surface,
                judged=samples,
                truth=TrueMotion.read(truths[number], patient, case) if truths else None,
                labels=labels | (skin.columns if skin else {}),
            )
        )
        logging.info("%s: CD %.3f mm, min J %.3f", case, rows[-1]["cd"], rows[-1]["min_jacobian"])
        if np.isfinite(points := prediction.moved_skin(patient)).all() and samples:
            moved[case] = compared(samples, patient, points)
    write_rows(rows, metrics, CASES)
    if skins:
        write_skins(skins, moved)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    evaluate(
        cases=snakemake.params.cases,
        predictions=snakemake.input.predictions,
        models=snakemake.input.models,
        plans=snakemake.input.plans,
        postops=dict(zip(snakemake.params.scanned, snakemake.input.get("postops", []), strict=True)),
        judged=dict(zip(snakemake.params.scanned, snakemake.input.get("judged", []), strict=True)),
        truths=snakemake.input.get("truths", []),
        fem=FemSettings(**snakemake.params.fem),
        labels={name: snakemake.wildcards[name] for name in ("fold", "method")} | {"code": snakemake.params.code},
        seed=snakemake.params.seed,
        metrics=snakemake.output.metrics,
        skins=snakemake.output.skins,
    )
