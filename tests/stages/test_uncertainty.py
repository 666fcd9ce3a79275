"""The stages of the interval on a coarse virtual patient: ensemble, calibration, coverage, a new patient."""

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import closest_points
from pinnochio.metrics.judged import Judged
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.predictions import Prediction, read_prediction, write_predictions
from pinnochio.model.regions import NAMES, NECK
from pinnochio.patients.in_distribution import widening
from pinnochio.statistics.conformal import UNSEEN
from pinnochio.statistics.intervals import Calibration, Interval, read_ensemble
from scripts.patients.predict_plan import compare
from scripts.prediction.calibrate import ScannedCase, calibrate
from scripts.prediction.predict_interval import predict_interval
from tests.helpers.settings import CONFIG, SEED, network_settings
from tests.helpers.tables import make
from tests.helpers.training import predict_all, predict_by, save_random

NETWORK = network_settings(boundary_layers=1, volume_layers=1, channels=16, heads=2)
FOLDS = ("1", "2", "3")
COUNTED = NAMES[:NECK]
LEVEL = 0.5  # what two patients can give a finite half-width


@pytest.fixture(scope="module")
def networks(tmp_path_factory):
    """An untrained network per fold, each its own."""
    folder, paths = tmp_path_factory.mktemp("networks"), {}
    for fold in FOLDS:
        paths[fold] = save_random(folder / f"{fold}.pt", NETWORK, int(fold))
    return paths


def predicted(patient, ensemble, calibration, training, result, plan=None):
    """The interval of the first patient."""
    ranges, (quality, *_) = training
    factor = widening(compare(patient.case, patient.model, plan or patient.plan, quality, ranges))
    predict_interval(patient.case, patient.model, ensemble, calibration, factor, patient.fem, result)


@pytest.fixture(scope="module")
def ensembles(patients, networks, tmp_path_factory):
    """File of each patient's predictions by every network."""
    folder, paths = tmp_path_factory.mktemp("ensembles"), {}
    for patient in patients:
        paths[patient.case] = str(folder / f"{patient.case}.h5")
        predict_all(networks, patient, paths[patient.case])
    return paths


def calibrated(patients, ensembles, folder, level=LEVEL, networks=True, truth=True):
    """Calibration and its table; every patient is held out of a fold of its own and predicted by that."""
    cases = []
    for fold, patient in zip(FOLDS, patients, strict=False):
        held_out = str(folder / f"predictions_{fold}.h5")
        write_predictions(held_out, {patient.case: read_prediction(ensembles[patient.case], fold)})
        paths = patient.model, patient.postop, patient.judged, held_out, ensembles[patient.case] if networks else None
        known = str(Path(patient.model).with_name("true_motion.h5")) if truth else None
        cases.append(ScannedCase(patient.case, fold, *paths, known))
    files = str(folder / "calibration.json"), str(folder / "part.csv")
    calibrate(cases, "pinnochio_plus", level, SEED, *files)
    return files


@pytest.fixture(scope="module")
def calibration(patients, ensembles, tmp_path_factory):
    return calibrated(patients, ensembles, tmp_path_factory.mktemp("calibration"))


def test_an_ensemble_holds_what_each_folds_network_predicts(patient, networks, ensembles, tmp_path):
    fields = read_ensemble(ensembles[patient.case])
    assert len(fields) == len(FOLDS)
    for fold, field in zip(FOLDS, fields, strict=True):
        alone = str(tmp_path / f"{fold}.h5")
        settings = {"fem": CONFIG["fem"], "newton_corrections": 0}
        predict_by("pinnochio.predictor:GraphPredictor", patient, alone, trained=networks[fold], **settings)
        np.testing.assert_allclose(field, read_prediction(alone, patient.case).displacement, atol=1e-6)
    assert min(np.abs(one - two).max() for one, two in combinations(fields, 2)) > 0.1


def test_calibration_holds_a_half_width_per_region(patients, calibration):
    stored = Calibration.read(calibration[0])
    assert (stored.patients, stored.folds, stored.level) == (2, 2, LEVEL)
    assert list(stored.half_width) == list(stored.usual_spread) == list(NAMES)
    assert list(stored.measures) == list(MEASURES) and all(width > 0 for width in stored.measures.values())


def test_a_method_without_networks_has_the_half_widths_of_its_errors_and_no_spread(
    patients, ensembles, calibration, tmp_path
):
    bare, _ = calibrated(patients, ensembles, tmp_path, networks=False, truth=False)
    assert Calibration.read(bare).half_width == Calibration.read(calibration[0]).half_width
    assert set(Calibration.read(bare).usual_spread.values()) == {None}
    unknown = {name for name, width in Calibration.read(bare).measures.items() if width is None}
    assert unknown == {*UNSEEN}  # of patients of a clinic, whose truth nobody knows


def test_a_method_of_the_skin_alone_has_half_widths_and_no_measures(patients, calibration, tmp_path):
    cases = []
    for fold, patient in zip(FOLDS, patients, strict=False):
        alone = str(tmp_path / f"{fold}.h5")
        points = len(PatientModel.read(patient.model).skin_points)
        write_predictions(alone, {patient.case: Prediction(None, skin=np.ones((points, 3)))})
        cases.append(ScannedCase(patient.case, fold, patient.model, patient.postop, patient.judged, alone, None))
    files = str(tmp_path / "calibration.json"), str(tmp_path / "part.csv")
    calibrate(cases, "pca_linear", LEVEL, SEED, *files)
    stored = Calibration.read(files[0])
    assert all(stored.half_width[name] > 0 for name in COUNTED) and set(stored.measures.values()) == {None}
    assert set(pd.read_csv(files[1])["region"]) == set(pd.read_csv(calibration[1])["region"]) - {*MEASURES, "measures"}


@pytest.mark.parametrize("region", COUNTED)
def test_the_half_width_covers_half_of_both_patients(patients, ensembles, calibration, region):
    """At a level of a half, two patients' half-width is the 75th percentile of both, by hand."""
    errors = []
    for fold, files in zip(FOLDS, patients, strict=False):
        patient, judged = PatientModel.read(files.model), Judged.read(files.judged)
        scan = PostopSkin.read(files.postop).surface
        skin = judged.before(patient).carried(
            patient.moved_skin(read_prediction(ensembles[files.case], fold).displacement)
        )
        errors.append(closest_points(skin[judged.skin_region == NAMES.index(region)], *scan).distance)
    width = Calibration.read(calibration[0]).half_width[region]
    share = sum(np.mean(distances <= width) for distances in errors) / 2
    assert 0.75 <= share < 0.75 + max(1 / len(distances) for distances in errors)


def test_the_table_of_coverage_is_written(calibration, tmp_path):
    table = tmp_path / "coverage.csv"
    make(table, "pinnochio.tables.coverage", parts=[calibration[1], calibration[1]], cohort="virtual cohort")
    rows = pd.read_csv(table)
    assert len(rows) == 2 * (len(COUNTED) + len(MEASURES) + 2) and (rows["n"] == 2).all()
    assert rows["coverage_mean"].between(0, 100).all()
    assert "virtual cohort" in (tmp_path / "coverage.md").read_text()
    assert (tmp_path / "coverage.tex").exists() and (tmp_path / "coverage.html").exists()


def test_a_new_patient_gets_field_and_interval(patient, ensembles, calibration, training, tmp_path):
    result = str(tmp_path / "interval.h5")
    predicted(patient, ensembles[patient.case], calibration[0], training, result)
    interval, model = Interval.read(result), PatientModel.read(patient.model)
    fields = read_ensemble(ensembles[patient.case])
    judged = (interval.region >= 0) & (interval.region != NECK)
    widths = np.array(list(Calibration.read(calibration[0]).half_width.values()), float)
    assert interval.displacement.shape == model.points.shape and interval.spread.shape == (len(model.points),)
    off = np.abs(interval.displacement - fields.mean(axis=0))
    assert np.median(off) < 1e-12  # but for what the inversion repair mended
    assert (interval.half_width[judged] >= widths[interval.region[judged]]).all()
    assert np.isnan(interval.half_width[~judged]).all()


def test_a_plan_beyond_the_training_widens_the_interval(patient, ensembles, calibration, training, tmp_path):
    ranges = json.loads(Path(training[0]).read_text())
    ranges["plan"]["threshold"] = 0.0  # two patients differ so much that hardly a plan is unusual
    (tmp_path / "ranges.json").write_text(json.dumps(ranges))

    def widths(plan):
        file, known = str(tmp_path / "interval.h5"), (str(tmp_path / "ranges.json"), training[1])
        predicted(patient, ensembles[patient.case], calibration[0], known, file, plan)
        return Interval.read(file).half_width

    usual, text = widths(None), json.loads(Path(patient.plan).read_text())
    ratios = []
    for forward in (15, 40):
        text["segments"]["lefort1"]["translation"] = [0, -forward, 0]
        (tmp_path / "far.json").write_text(json.dumps(text))
        ratios.append(np.nanmedian(widths(str(tmp_path / "far.json")) / usual))
    assert 1 < ratios[0] < ratios[1]


def test_the_mean_field_leaves_with_no_inverted_element(patient, calibration, training, tmp_path):
    model = PatientModel.read(patient.model)
    bad = np.zeros_like(model.points)
    cell = model.cells[(model.node_type[model.cells] == FREE).all(axis=1)][0]
    bad[cell[0]] = 2 * (model.points[cell[1:]].mean(axis=0) - model.points[cell[0]])
    write_predictions(tmp_path / "ensemble.h5", {fold: Prediction(bad) for fold in FOLDS})
    result = str(tmp_path / "interval.h5")
    predicted(patient, str(tmp_path / "ensemble.h5"), calibration[0], training, result)

    def volumes(points):
        corners = points[model.cells]
        return np.linalg.det(corners[:, 1:] - corners[:, :1])

    assert volumes(model.points + bad).min() < 0 < volumes(model.points + Interval.read(result).displacement).min()


def test_too_few_patients_are_said_to_be_so(patients, ensembles, training, tmp_path):
    files = calibrated(patients, ensembles, tmp_path, level=0.9)
    assert set(Calibration.read(files[0]).half_width.values()) == {None}
    assert pd.read_csv(files[1])["coverage_mean"].isna().all()
    patient = patients[0]
    with pytest.raises(InputError, match="2 patients are too few"):
        predicted(patient, ensembles[patient.case], files[0], training, str(tmp_path / "i.h5"))
