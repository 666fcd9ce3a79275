"""Inversion repair of a network's prediction, and its corrections up to their table, on one coarse patient."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.errors import InputError
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.validity import equilibrium_of
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.predictions import Prediction, read_prediction, write_predictions
from scripts.tables.render_table import render_table
from studies.corrections.correct import correct
from studies.corrections.table import CORRECTIONS
from tests.helpers.settings import CONFIG, SEED, network_settings
from tests.helpers.tables import make
from tests.helpers.training import measured, predict_by, save_random

NETWORK = network_settings(boundary_layers=1, volume_layers=2, channels=16, heads=2, neighbours=4)
COUNTS = (0, 1, 3, 8)


@pytest.fixture(scope="module")
def wild_network(tmp_path_factory):
    """A network of random weights: its field has inverted elements."""
    path = tmp_path_factory.mktemp("network") / "network.pt"
    return save_random(path, NETWORK, size=0.2, training={}, seed=SEED)


@pytest.mark.parametrize("corrections", [0, pytest.param(2, marks=pytest.mark.full)])
def test_no_prediction_leaves_with_an_inverted_element(patient, wild_network, corrections, tmp_path):
    path = tmp_path / "predictions.h5"
    settings = {"fem": CONFIG["fem"], "newton_corrections": corrections}
    predict_by("pinnochio.predictor:GraphPredictor", patient, str(path), trained=wild_network, **settings)
    prediction, model = read_prediction(path, patient.case), PatientModel.read(patient.model)
    assert jacobians(model.points, model.cells, prediction.raw).min() < 0
    assert jacobians(model.points, model.cells, prediction.displacement).min() > 0
    assert prediction.repaired > 0 or prediction.damping < 1
    assert prediction.boundary.shape == model.points.shape and prediction.iterations == corrections


@pytest.fixture(scope="module")
def corrected(patient, tmp_path_factory):
    """A prediction made of the finite-element field and noise, corrected."""
    folder, model = tmp_path_factory.mktemp("corrections"), PatientModel.read(patient.model)
    with h5py.File(patient.fem_samples) as file:
        field = file["plan_0/displacement"][()]
    boundary = np.where((model.node_type != FREE)[:, None], field, 0.0)
    start = field + 0.05 * np.random.default_rng(0).normal(size=field.shape)
    made = Prediction(start, 0.1, 0.5, boundary=boundary, raw=start, repaired=0, damping=1)
    write_predictions(folder / "predictions.h5", {patient.case: made})
    files = {count: str(folder / f"corrected_{count}.h5") for count in COUNTS}
    correct([patient.case], str(folder / "predictions.h5"), [patient.model], patient.fem, 1, files)
    return files


def test_more_corrections_come_nearer_to_the_field_in_equilibrium(patient, corrected):
    model = PatientModel.read(patient.model)
    with h5py.File(patient.fem_samples) as file:
        field = file["plan_0/displacement"][()]
    predictions = {count: read_prediction(path, patient.case) for count, path in corrected.items()}
    away = [np.abs(predictions[count].displacement - field).max() for count in COUNTS]
    assert away[0] > 0.1 > away[1] > away[2] >= away[3] and away[3] < 1e-4
    constrained = model.node_type != FREE
    np.testing.assert_allclose(predictions[1].displacement[constrained], field[constrained], atol=1e-12)
    seconds = [predictions[count].seconds for count in COUNTS]
    assert seconds[0] == 0.1 and (np.diff(seconds) >= 0).all() and seconds[1] > 0.1
    assert predictions[3].setup_seconds == 0.5 and 3 <= predictions[8].iterations <= 8
    np.testing.assert_array_equal(predictions[8].raw, predictions[0].displacement)


def test_seconds_are_counted_without_the_corrections_that_a_prediction_holds(patient, corrected, tmp_path):
    """A method that is corrected once begins with its network's field here, too."""
    network = read_prediction(corrected[0], patient.case)
    once = replace(read_prediction(corrected[1], patient.case), seconds=5.0)
    write_predictions(tmp_path / "once.h5", {patient.case: once})
    files = {count: str(tmp_path / f"{count}.h5") for count in (0, 1)}
    correct([patient.case], str(tmp_path / "once.h5"), [patient.model], patient.fem, 1, files)
    none, again = (read_prediction(files[count], patient.case) for count in files)
    np.testing.assert_array_equal(none.displacement, network.displacement)
    np.testing.assert_allclose(again.displacement, once.displacement, atol=1e-9)
    assert none.seconds < again.seconds == 5.0 and (none.iterations, again.iterations) == (0, 1)


def test_a_declared_load_stays_on(patient, tmp_path):
    """Equilibrium is with it: what was learned is not corrected away."""
    model, path = PatientModel.read(patient.model), str(tmp_path / "predictions.h5")
    with h5py.File(patient.fem_samples) as file:
        field = file["plan_0/displacement"][()]
    boundary = np.where((model.node_type != FREE)[:, None], field, 0.0)
    forces = np.where((model.node_type == FREE)[:, None], [0.0, -2.0, 0.0], 0.0)
    made = Prediction(field, boundary=boundary, raw=field, repaired=0, damping=1, forces=forces)
    write_predictions(path, {patient.case: made})
    correct([patient.case], path, [patient.model], patient.fem, 1, {8: str(tmp_path / "corrected.h5")})
    corrected = read_prediction(tmp_path / "corrected.h5", patient.case)
    assert equilibrium_of(model, corrected.displacement, patient.fem, corrected.forces)["eqres_rel"] < 1e-5
    assert equilibrium_of(model, corrected.displacement, patient.fem)["eqres_rel"] > 1e-2
    assert (corrected.displacement - field)[model.node_type == FREE, 1].min() < -0.1


def test_a_method_without_an_interface_is_refused(patient, tmp_path):
    model = PatientModel.read(patient.model)
    write_predictions(tmp_path / "fem.h5", {patient.case: Prediction(np.zeros_like(model.points))})
    with pytest.raises(InputError, match=f"'{patient.case}'.*gives no interface.*Remedy"):
        correct([patient.case], str(tmp_path / "fem.h5"), [patient.model], patient.fem, 1, {1: str(tmp_path / "a.h5")})
    assert not (tmp_path / "a.h5").exists()


def test_the_table_and_the_picture_come_from_the_fields(patient, corrected, tmp_path):
    metrics = []
    for count, path in corrected.items():
        metrics.append(str(tmp_path / f"{count}.csv"))
        measured(patient, path, metrics[-1], "pinnochio")
    first = read_table(metrics[0], CASES).iloc[0]
    for name in ("min_jacobian", "inverted", "eqres_paper", "eqres_rel"):
        assert first[f"raw_{name}"] == first[name]  # not yet repaired
    last = read_table(metrics[-1], CASES).iloc[0]
    assert last["raw_eqres_rel"] == first["eqres_rel"] > 1e3 * last["eqres_rel"]
    assert first["interface_error"] > 0.05 and first["damping"] == 1
    arguments = {"methods": ["pinnochio"], "corrections": list(corrected), "cohort": "virtual cohort", "seed": SEED}
    make(tmp_path / "corrections.csv", "studies.corrections.table", metrics=metrics, **arguments)
    table = read_table(tmp_path / "corrections.csv", CORRECTIONS)
    assert list(table["corrections"]) == list(COUNTS) and (table["inverted"] == 0).all()
    residual = table["eqres_rel_mean"].to_numpy()
    assert residual[0] > 0.1 > 1e-3 > residual[2] >= residual[3] and residual[3] < 1e-6
    assert table["interface_error_mean"][1:].max() < 1e-9
    render_table(str(tmp_path / "corrections.csv"), "studies.corrections.figure", [str(tmp_path / "corrections.png")])
    assert (tmp_path / "corrections.png").stat().st_size > 20_000
