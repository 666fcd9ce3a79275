"""The systems that the study compares with, from a patient's files to rows of the table."""

import numpy as np
import pandas as pd
import pytest

from scripts.evaluate import evaluate
from scripts.finetune import finetune
from scripts.fit import fit
from scripts.pretrain import pretrain
from tests.helpers.settings import CONFIG, SEED
from tests.helpers.training import predict_by


def measured(patient, predictions, metrics):
    labels = {"fold": "1", "method": "some", "code": "x"}
    evaluate(
        [patient.case], predictions, [patient.model], [patient.plan], {patient.case: patient.postop},
        {patient.case: patient.judged}, [patient.truth], patient.fem, labels, SEED, metrics,
    )  # fmt: skip
    return pd.read_csv(metrics).loc[0]


@pytest.mark.parametrize("architecture", ["acmt", "dgcfp"])
def test_a_surface_network_from_fields_and_skin_to_a_row_of_the_table(patient, tmp_path, architecture):
    phase = CONFIG["surface"]["networks"][architecture]["finetuning"] | {"steps": 3, "batch": 2}
    settings = {"network": {"architecture": architecture, "points": 64, "neighbours": 8, "repeats": 1}}
    settings |= {"pretraining": phase, "finetuning": phase}
    first, last = ({name: str(tmp_path / f"{phase}_{name}") for name in ("network", "history")} for phase in "ab")
    own = {"module": "pinnochio.methods.surface.learner", "settings": settings, "code": "x", "device": "cpu"}
    own |= {"cases": [patient.case], "models": [patient.model], "lifts": []}
    pretrain(**own, fem_samples=[patient.fem_samples], seed=1, outputs=first)
    outcome = {"plans": [patient.plan], "postops": [patient.postop], "pretrained": first["network"]}
    finetune(**own, **outcome, seed=2, outputs=last)
    predictions, metrics = str(tmp_path / "predictions.h5"), str(tmp_path / "metrics.csv")
    predict_by("surface.predictor", patient, predictions, trained=last["network"])
    row = measured(patient, predictions, metrics)
    assert row["cd"] > 0 and row["skin_error_mean"] > 0 and row["seconds"] > 0
    assert row[["min_jacobian", "eqres_rel", "volume_error_mean", "moving_error", "eqres_element"]].isna().all()


def test_floors_need_no_network(patient, tmp_path):
    fitted, rows = str(tmp_path / "fitted.h5"), {}
    fit(
        module="pinnochio.methods.pca_linear",
        cases=[patient.case],
        models=[patient.model],
        fem_samples=[patient.fem_samples],
        plans=[patient.plan],
        postops=[patient.postop],
        fitted=fitted,
    )
    for name in ("ratio", "pca_linear", "elastic", "no_change"):
        predict_by(name, patient, str(tmp_path / f"{name}.h5"), trained=fitted, fem=CONFIG["fem"])
        rows[name] = measured(patient, str(tmp_path / f"{name}.h5"), str(tmp_path / f"{name}.csv"))
    for name, most in (("ratio", 1.0), ("elastic", 0.8)):
        assert rows[name]["skin_error_mean"] < most * rows["no_change"]["skin_error_mean"], name
    assert rows["elastic"]["min_jacobian"] > 0 and rows["elastic"]["setup_seconds"] > rows["elastic"]["seconds"]
    assert rows["elastic"]["moving_error"] < 1e-6 < rows["no_change"]["moving_error"]
    assert np.isnan(rows["ratio"]["min_jacobian"])
