"""Methods made elsewhere, patients without a scan, and what is judged anew, on the files of one coarse patient."""

import csv
import logging

import pandas as pd
import pytest

from pinnochio.metrics.region_errors import LANDMARKS, SHOWN
from scripts.prediction.list_folds import list_folds
from scripts.prediction.predict_cases import OUTPUTS, predict_cases
from tests.helpers.settings import CONFIG, SEED
from tests.helpers.tables import make
from tests.helpers.training import measured, predict_by

ACCURACY = ["cd", "cd_sum", "cd_sq", "cd_vertex", "hd95", "p99", "hdmax", "hd_mean_oneway"]
ACCURACY += ["pwr1", "pwr2", "pwr1_target", "pwr2_target", "target_samples", "skin_samples"]
ACCURACY += ["registration_residual", "registration_p95", "registration_bias", "apart"]
RAW = ["raw_min_jacobian", "raw_inverted", "raw_eqres_paper", "raw_eqres_rel"]
GUARD = [*RAW, "repaired", "damping", "interface_error"]  # of networks alone
ACCURACY += [f"{kind}_{name}" for name in SHOWN for kind in ("region", "bias")]
TRUTH = ["volume_error_mean", "volume_error_p95", "skin_error_mean", "skin_error_p95"]
TRUTH += [f"landmark_{name}" for name in LANDMARKS]


UNSCANNED = {"postops": {}, "judged": {}, "motions": []}


@pytest.fixture(scope="module")
def solved(patient, tmp_path_factory) -> str:
    path = str(tmp_path_factory.mktemp("solved") / "predictions.h5")
    predict_by("finite_elements:FiniteElementPredictor", patient, path, fem=CONFIG["fem"], contact="bonded")
    return path


def test_without_a_scan_everything_but_accuracy_is_measured(patient, solved, tmp_path):
    row = measured(patient, solved, str(tmp_path / "metrics.csv"), **UNSCANNED)
    assert row[ACCURACY + TRUTH + GUARD].isna().all(None)
    rest = row.drop(columns=ACCURACY + TRUTH + GUARD)
    assert rest.notna().all(None) and rest.loc[0, "min_jacobian"] > 0 and rest.loc[0, "moving_error"] < 1e-6


def test_patients_without_a_scan_do_not_count_as_failed(patient, solved, tmp_path):
    scanned, unscanned = str(tmp_path / "1.csv"), str(tmp_path / "2.csv")
    measured(patient, solved, scanned, "fem_bonded", motions=[])
    frame = measured(patient, solved, unscanned, "fem_bonded", **UNSCANNED)
    frame.assign(case="unscanned").to_csv(unscanned, index=False)
    cases, table = tmp_path / "cases.csv", tmp_path / "accuracy.csv"
    make(cases, "pinnochio.tables.cases", metrics=[scanned, unscanned], cohort="test clinic")
    compared = {"methods": ["fem_bonded"], "bounds": [], "reference": None, "published": False}
    make(table, "pinnochio.tables.accuracy", cases=cases, cohort="test clinic", seed=SEED, **compared)
    accuracy = pd.read_csv(table)
    assert len(pd.read_csv(cases)) == 2 and accuracy.loc[0, ["n", "failed"]].tolist() == [1, 0]
    assert accuracy.loc[0, "cd_mean"] == pytest.approx(pd.read_csv(scanned).loc[0, "cd"], abs=1e-4)


def test_folds_are_listed_by_case(tmp_path):
    list_folds({"1": ["A", "C"], "2": ["B"]}, ["A", "B"], str(tmp_path / "folds.csv"))
    with open(tmp_path / "folds.csv") as file:
        rows = list(csv.reader(file))
    assert rows == [["case", "fold", "scanned"], ["A", "1", "True"], ["B", "2", "True"], ["C", "1", "False"]]


def test_other_metrics_judge_anew_what_has_been_predicted(patient, tmp_path, caplog):
    """From both motions in one job, each with files of its own."""
    caplog.set_level(logging.INFO)
    motions = [([plan], {name: str(tmp_path / f"{name}_{n}") for name in OUTPUTS}) for n, plan in
               enumerate((patient.executed, patient.plan))]  # fmt: skip
    method = {"predictor": "pinnochio.methods.no_change:NoChangePredictor", "settings": {}, "device": "cpu"}
    method |= {"names": [patient.case], "cases": [patient.case], "threads": 1}
    files = {"models": [patient.model], "motions": [patient.true_motion]}
    files |= {"postops": {patient.case: patient.postop}, "judged": {patient.case: patient.judged}}
    settings = {"cases": [patient.case], "fem": patient.fem, "seed": SEED}
    unread = dict.fromkeys(("trained", "lifts", "truths", "covariates"), [])
    for code in ("one", "other"):
        caplog.clear()
        labels = {"fold": "1", "method": "no_change", "code": code}
        judged = {"files": files, "settings": settings | {"labels": labels}}
        predict_cases({"models": [patient.model], **unread}, method, judged, motions)
        rows = [pd.read_csv(made["metrics"]) for _, made in motions]
        assert [row["code"].item() for row in rows] == [code, code]
    kept = [record.getMessage() for record in caplog.records if record.getMessage().endswith("kept")]
    assert kept == ["predict predictions_0 predictions_1: kept"]
    alone = {"plans": [[patient.plan]], "labels": labels}
    row = measured(patient, motions[1][1]["predictions"], str(tmp_path / "alone.csv"), **alone)
    pd.testing.assert_frame_equal(row, rows[1])
    assert rows[0]["moving_error"].item() != rows[1]["moving_error"].item()
