"""Inversion repair of a network's prediction, on one coarse patient."""

import pytest

from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from tests.helpers.settings import CONFIG, SEED, network_settings
from tests.helpers.training import predict_by, save_random

NETWORK = network_settings(boundary_layers=1, volume_layers=2, channels=16, heads=2, neighbours=4)


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
