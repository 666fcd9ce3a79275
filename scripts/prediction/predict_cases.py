"""Makes a method's predictions of a fold's held-out patients, and their metrics."""

from collections.abc import Mapping
from pathlib import Path

from pinnochio.logs import attach_log
from pinnochio.stages import Stages
from pinnochio.training.device import device_of
from scripts.prediction.predict import predict
from scripts.tables.evaluate import evaluate, judging


def predict_cases(
    read: Mapping[str, object], method: Mapping[str, object], judged: Mapping[str, dict], outputs: Mapping[str, str]
) -> None:
    """Predict, then judge; other metrics predict nothing anew.

    read, method: inputs and settings of :func:`~scripts.prediction.predict.predict`; judged: files and settings of
    :func:`~scripts.tables.evaluate.evaluate`; outputs: files predictions, metrics, skins.
    """
    predictions = {"predictions": outputs["predictions"]}
    stages = Stages(Path(outputs["predictions"]).with_name(".predict_cases.json"))
    stages(predict, read, predictions, method)
    measured = {name: outputs[name] for name in ("metrics", "skins")}
    stages(evaluate, judged["files"] | predictions, measured, judged["settings"])


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files, params = snakemake.input, snakemake.params
    device = device_of(params.predictor, snakemake.resources.gpu, snakemake.threads)
    method = {"predictor": params.predictor, "settings": params.settings, "device": device}
    named = {"names": params.cases, "cases": params.cases}
    predict_cases(
        read={name: files.get(name, []) for name in ("models", "plans", "trained", "lifts", "truths", "covariates")},
        method=method | named | {"threads": snakemake.threads},
        judged=judging(job=snakemake),
        outputs=dict(snakemake.output.items()),
    )
