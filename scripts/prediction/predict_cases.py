"""Makes a method's predictions of a fold's held-out patients, and their metrics."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.stages import Stages
from pinnochio.training.device import device_of
from scripts.prediction.predict import predict
from scripts.tables.evaluate import evaluate, files_of, judging

OUTPUTS = ("predictions", "metrics", "skins")


def predict_cases(
    read: Mapping[str, object],
    method: Mapping[str, object],
    judged: Mapping[str, dict],
    motions: Sequence[tuple[Sequence[str], Mapping[str, str]]],
) -> None:
    """Predict, then judge; other metrics predict nothing anew.

    read, method: inputs and settings of :func:`~scripts.prediction.predict.predict`; judged: files and settings of
    :func:`~scripts.tables.evaluate.evaluate`; motions: plans with the files of OUTPUTS.
    """
    with Stages(Path(motions[0][1]["predictions"]).with_name(".predict_cases.json")) as stages:
        made = {name: [outputs[name] for _, outputs in motions] for name in OUTPUTS}
        plans = {"plans": [plans for plans, _ in motions]}
        stages(predict, {**read, **plans}, {"predictions": made["predictions"]}, method)
        stages(evaluate, {**judged["files"], **plans, "predictions": made.pop("predictions")}, made, judged["settings"])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    made, params = dict(snakemake.output.items()), snakemake.params
    files, arms = files_of(job=snakemake), {"folds_": "executed", "planned_": "planned"}
    if "predictions" in made:
        arms = {"": "plans"}
    device = device_of(params.predictor, snakemake.resources.gpu, snakemake.threads)
    method = {"predictor": params.predictor, "settings": params.settings, "device": device}
    named = {"names": params.cases, "cases": params.cases}
    predict_cases(
        read={name: files[name] for name in ("models", "trained", "lifts", "truths", "covariates")},
        method=method | named | {"threads": snakemake.threads},
        judged=judging(job=snakemake, files=files),
        motions=[(files[plans], {name: made[f"{arm}{name}"] for name in OUTPUTS}) for arm, plans in arms.items()],
    )
