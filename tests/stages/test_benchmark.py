"""Methods made elsewhere and patients without a scan, on the files of one coarse virtual patient."""

import csv

import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from pinnochio.errors import InputError
from pinnochio.metrics.region_errors import LANDMARKS, REGIONS
from pinnochio.model.predictions import read_prediction
from scripts.prediction.list_folds import list_folds
from scripts.prediction.predict_external import predict_external
from tests.helpers.settings import CONFIG, SEED
from tests.helpers.tables import make
from tests.helpers.training import measured, predict_by

PREDICTOR = ["method", "device", "seconds", "setup_seconds", "threads", "reason"]  # columns that say who predicted
ACCURACY = ["cd", "cd_sum", "cd_sq", "cd_vertex", "hd95", "hdmax", "hd_mean_oneway"]
ACCURACY += ["pwr1", "pwr2", "pwr1_target", "pwr2_target", "target_samples", "skin_samples"]
ACCURACY += ["registration_residual"]
RAW = ["raw_min_jacobian", "raw_inverted", "raw_eqres_paper", "raw_eqres_rel"]
GUARD = [*RAW, "repaired", "damping", "interface_error"]  # of networks alone
ACCURACY += [f"{kind}_{name}" for name in REGIONS for kind in ("region", "bias")]
TRUTH = ["volume_error_mean", "volume_error_p95", "skin_error_mean", "skin_error_p95"]
TRUTH += [f"landmark_{name}" for name in LANDMARKS]


UNSCANNED = {"postops": {}, "judged": {}, "truths": []}


@pytest.fixture(scope="module")
def solved(patient, tmp_path_factory) -> str:
    path = str(tmp_path_factory.mktemp("solved") / "predictions.h5")
    predict_by("finite_elements:FiniteElementPredictor", patient, path, fem=CONFIG["fem"], contact="bonded")
    return path


def export(patient, solved, folder):
    """The solved field as others would deliver it: as NPZ, and as VTU with its nodes in another order."""
    field, mesh = read_prediction(solved, patient.case).displacement, pv.read(patient.mesh)
    npz, vtu = str(folder / "mine.npz"), str(folder / "mine.vtu")
    np.savez(npz, displacement=field, seconds=0.25)
    order = np.random.default_rng(0).permutation(mesh.n_points)
    cells = np.argsort(order)[mesh.cells_dict[pv.CellType.TETRA]]
    shuffled = pv.UnstructuredGrid({pv.CellType.TETRA: cells[::-1]}, mesh.points[order].astype(np.float32))
    shuffled.point_data["displacement"] = field[order]
    shuffled.save(vtu)
    return npz, vtu


def test_a_field_made_elsewhere_gets_the_same_row(patient, solved, tmp_path):
    mesh = pv.read(patient.mesh)
    assert len(np.unique(mesh.points, axis=0)) < mesh.n_points  # the mouth slit: places do not tell all nodes apart
    solved_here = measured(patient, solved, str(tmp_path / "own.csv"))
    for number, file in enumerate(export(patient, solved, tmp_path)):
        predictions = str(tmp_path / f"{number}.h5")
        predict_external([patient.case], [file], [patient.mesh], predictions)
        row = measured(patient, predictions, str(tmp_path / f"{number}.csv"), "mine")
        pd.testing.assert_frame_equal(row.drop(columns=PREDICTOR), solved_here.drop(columns=PREDICTOR))
        assert row.loc[0, "device"] == "external" and row["setup_seconds"].isna().all()
        assert row.loc[0, "seconds"] == 0.25 if number == 0 else row["seconds"].isna().all()


def test_the_field_of_another_patient_is_refused(patients, solved, tmp_path):
    one, two = patients
    for file in export(one, solved, tmp_path):
        with pytest.raises(InputError, match=f"'{two.case}'.*mine.*Remedy"):
            predict_external([two.case], [file], [two.mesh], str(tmp_path / "predictions.h5"))
    assert not (tmp_path / "predictions.h5").exists()


def test_without_a_scan_everything_but_accuracy_is_measured(patient, solved, tmp_path):
    row = measured(patient, solved, str(tmp_path / "metrics.csv"), **UNSCANNED)
    assert row[ACCURACY + TRUTH + GUARD].isna().all(None)
    rest = row.drop(columns=ACCURACY + TRUTH + GUARD)
    assert rest.notna().all(None) and rest.loc[0, "min_jacobian"] > 0 and rest.loc[0, "moving_error"] < 1e-6


def test_patients_without_a_scan_do_not_count_as_failed(patient, solved, tmp_path):
    scanned, unscanned = str(tmp_path / "1.csv"), str(tmp_path / "2.csv")
    measured(patient, solved, scanned, "fem_bonded", truths=[])
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
