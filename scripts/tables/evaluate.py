"""Makes the metrics of a method on a fold's held-out patients, of each motion by itself."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pinnochio.columns import write_rows
from pinnochio.gathered import gathered, gathered_files
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.evaluation import CaseJudge
from pinnochio.metrics.judged import Judged
from pinnochio.metrics.worst_point import EVERY, write_skins
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import read_prediction
from pinnochio.model.truth import TrueMotion
from pinnochio.plans.plan import Plan


def evaluate(
    cases: Sequence[str],
    predictions: Sequence[str],
    models: Sequence[str],
    plans: Sequence[Sequence[str]],
    postops: Mapping[str, str],
    judged: Mapping[str, str],
    motions: Sequence[str],
    fem: FemSettings,
    labels: dict,
    seed: int,
    metrics: Sequence[str],
    skins: Sequence[str] = (),
) -> None:
    """Write one row per case, and where the judged skin goes (skins); labels are fold, method and code.

    predictions, plans, metrics and skins: one file, or such files, of each motion that is judged. postops, judged:
    files by case of those that have a scan, the others get no accuracy; motions: true ones at the points of the models,
    none without a virtual truth.
    """
    rows, moved = [[] for _ in predictions], [{} for _ in predictions]
    for number, case in enumerate(cases):
        patient = PatientModel.read(models[number])
        skin = PostopSkin.read(postops[case]) if case in postops else None
        judge = CaseJudge(
            patient,
            fem=fem,
            seed=seed,
            target=skin and skin.surface,
            judged=skin and Judged.read(judged[case]),
            truth=TrueMotion.read(motions[number], patient, case) if motions else None,
            labels=labels | (skin.columns if skin else {}),
        )
        for motion, file in enumerate(predictions):
            prediction = read_prediction(file, case)
            rows[motion].append(row := judge.row(Plan.read(plans[motion][number], case), prediction))
            logging.info("%s: CD %.3f mm, min J %.3f", case, row["cd"], row["min_jacobian"])
            if np.isfinite(points := prediction.moved_skin(patient)).all() and skin:
                moved[motion][case] = judge.before.carried(points)[::EVERY]
    for file, made in zip(metrics, rows, strict=True):
        write_rows(made, file, CASES)
    for file, made in zip(skins, moved, strict=bool(skins)):
        write_skins(file, made)


def files_of(job) -> dict[str, list[str]]:
    """Files of the cases of a job of Snakemake's, in their order, by the names that :func:`evaluate` and
    :func:`~scripts.prediction.predict.predict` have for them; plans are those of the job's batch, planned or executed.
    """
    there, cases, scanned = job.input, job.params.cases, job.params.scanned
    lips = "lips/" if Path(there.models[0]).name == "lips" else ""
    planned = gathered(there.scans, cases, "plan.json")
    executed = list(there.executed) or gathered(there.scans, cases, "motion.json")
    return {
        **gathered_files(there, cases, "lifts", "covariates"),
        "models": gathered(there.models, cases, f"{lips}model.h5"),
        "trained": list(there.trained),
        "truths": list(there.truths),
        "plans": planned if job.wildcards.get("batch", "").startswith("planned") else executed,
        "planned": planned,
        "executed": executed,
        **gathered_files(there, scanned, "postops"),
        "judged": gathered(there.judged, scanned, "judged.h5"),
        "motions": gathered(there.models if lips else there.judged, cases, f"{lips}true_motion.h5", some=False),
    }


def judging(job, files: Mapping[str, Sequence[str]]) -> dict[str, dict]:
    """What :func:`evaluate` reads of the files, and is set to, in a job that names method and fold, or the batch."""
    fold = job.wildcards.get("fold") or Path(job.wildcards.batch).name
    about = {"fold": fold, "method": job.wildcards.method, "code": job.params.code}
    scans = {name: dict(zip(job.params.scanned, files[name], strict=True)) for name in ("postops", "judged")}
    settings = {"cases": job.params.cases, "fem": FemSettings(**job.params.fem), "seed": job.params.seed}
    files = scans | {name: files[name] for name in ("models", "plans", "motions")}
    return {"files": files, "settings": settings | {"labels": about}}


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    judged = judging(job=snakemake, files=files_of(job=snakemake))
    evaluate(
        **judged["files"] | {"plans": [judged["files"]["plans"]]},
        **judged["settings"],
        predictions=[snakemake.input.predictions],
        **{name: [file] for name, file in snakemake.output.items()},
    )
