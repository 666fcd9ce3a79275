"""The systems that the study compares with, from a patient's files to rows of the table."""

import numpy as np
import pandas as pd
import pytest

from pinnochio.methods.surface.settings import training_settings
from scripts.evaluate import evaluate
from scripts.finetune_surface import finetune_surface
from scripts.fit_linear import fit_linear
from scripts.predict_elastic import predict_elastic
from scripts.predict_no_change import predict_no_change
from scripts.predict_rule import predict_rule
from scripts.predict_surface import predict_surface
from scripts.pretrain_surface import pretrain_surface
from tests.helpers.settings import surface_settings
from tests.stages.conftest import CONFIG, SEED


def measured(patient, predictions, metrics):
    labels = {"fold": "1", "method": "some", "code": "x"}
    evaluate(
        [patient.case], predictions, [patient.model], [patient.plan], {patient.case: patient.postop}, [patient.truth],
        2000, patient.fem, labels, SEED, metrics,
    )  # fmt: skip
    return pd.read_csv(metrics).loc[0]


@pytest.mark.parametrize("architecture", ["acmt", "dgcfp"])
def test_a_surface_network_from_fields_and_skin_to_a_row_of_the_table(patient, tmp_path, architecture):
    settings = surface_settings(architecture, points=64, neighbours=8, repeats=1)
    training = training_settings(CONFIG["surface"]["networks"][architecture]["finetuning"] | {"steps": 3, "batch": 2})
    first, last = ({name: str(tmp_path / f"{phase}_{name}") for name in ("network", "history")} for phase in "ab")
    own = [patient.case], [patient.model]
    pretrain_surface(*own, [patient.fem_samples], settings, training, 1, "cpu", first)
    finetune_surface(*own, [patient.plan], [patient.postop], first["network"], settings, training, 2, "cpu", last)
    predictions, metrics = str(tmp_path / "predictions.h5"), str(tmp_path / "metrics.csv")
    predict_surface(*own, [patient.plan], last["network"], "cpu", 1, predictions)
    row = measured(patient, predictions, metrics)
    assert row["cd"] > 0 and row["skin_error_mean"] > 0 and row["seconds"] > 0
    assert row[["min_jacobian", "eqres_rel", "volume_error_mean", "moving_error", "eqres_element"]].isna().all()


def test_floors_need_no_network(patient, tmp_path):
    own, rows = ([patient.case], [patient.model], [patient.plan]), {}
    linear = str(tmp_path / "linear.h5")
    fit_linear([patient.case], [patient.model], [patient.fem_samples], [patient.plan], [patient.postop], linear)
    predict_rule(*own, None, 1, str(tmp_path / "ratio.h5"))
    predict_rule(*own, linear, 1, str(tmp_path / "pca_linear.h5"))
    predict_elastic(*own, patient.fem, 1, str(tmp_path / "elastic.h5"))
    predict_no_change(*own[:2], str(tmp_path / "no_change.h5"))
    for name in ("ratio", "pca_linear", "elastic", "no_change"):
        rows[name] = measured(patient, str(tmp_path / f"{name}.h5"), str(tmp_path / f"{name}.csv"))
    for name, most in (("ratio", 1.0), ("elastic", 0.8)):
        assert rows[name]["skin_error_mean"] < most * rows["no_change"]["skin_error_mean"], name
    assert rows["elastic"]["min_jacobian"] > 0 and rows["elastic"]["setup_seconds"] > rows["elastic"]["seconds"]
    assert rows["elastic"]["moving_error"] < 1e-6 < rows["no_change"]["moving_error"]
    assert np.isnan(rows["ratio"]["min_jacobian"])
