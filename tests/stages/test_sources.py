"""Loads that are learned: what scans hold of a known load is found again, and a prediction declares its load."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.methods.pinnochio.predictor import load_network
from pinnochio.methods.sources import ANCHORS, Deviation, PatientSources, fit, sources_of
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.networks.building import build
from pinnochio.plans.plan import Plan
from pinnochio.training.checkpoint import save_network
from scripts.training.finetune import finetune
from tests.helpers.settings import CONFIG, SEED, network_settings
from tests.helpers.training import learn_loads, measured, predict_by


@pytest.fixture(scope="module")
def faces(patients):
    """Two patients' models and plans."""
    models = [PatientModel.read(files.model) for files in patients]
    return models, [Plan.read(files.plan, files.case) for files in patients]


@pytest.fixture(scope="module")
def unloaded(patients, faces):
    """What is learned of faces that are as finite elements say, and each patient's sources."""
    models, plans = faces
    model = learned(patients, faces, [0 * head.points for head in models])
    return model, [sources_of(head, model.anchors, model.landmarks, patients[0].fem) for head in models]


def learned(patients, faces, fields):
    """The model of skins that the fields (n, 3) mm move, from bases that are zero."""
    models, plans = faces
    skins = [(head.moved_skin(field), head.skin_faces) for head, field in zip(models, fields, strict=True)]
    return fit(models, [0 * head.points for head in models], plans, skins, [{}, {}], patients[0].fem)


def on_face(head, field):
    return (head.moved_skin(field) - head.skin_points)[head.judged_points]


@pytest.mark.parametrize("turn", [0.5, -0.4])
def test_a_turn_of_the_weight_is_learned(patients, faces, unloaded, turn):
    """And nothing where nothing deviates."""
    assert abs(unloaded[0].weight) < 1e-9 and unloaded[0].regression.form == "zero"
    amplitudes = np.append(np.zeros(2 * ANCHORS), turn)
    fields = [sources.field(amplitudes) for sources in unloaded[1]]
    model = learned(patients, faces, fields)
    assert model.weight == pytest.approx(turn, rel=0.03)
    for head, plan, field in zip(*faces, fields, strict=True):
        sources = PatientSources(model, head, patients[0].fem, {})
        off = on_face(head, sources.sources.field(sources.amplitudes(plan)) - field)
        assert np.linalg.norm(off) < 0.03 * np.linalg.norm(on_face(head, field))


def test_pressures_under_the_skin_are_read_from_a_scan(faces, unloaded):
    """One patient's, one at each anchor, beside a known turn of the weight; along the normals."""
    (head, _), (sources, _) = faces[0], unloaded[1]
    amplitudes = np.append(0.2 * np.random.default_rng(0).normal(size=2 * ANCHORS), 0.1)
    field = sources.field(amplitudes)
    scan = head.moved_skin(field), head.skin_faces
    read = Deviation.of(head, 0 * head.points, scan, sources).amplitudes(0.1)
    normals = vertex_normals(head.skin_points, head.skin_faces)[head.judged_points]
    shown, left = (
        np.einsum("kx,kx->k", on_face(head, each), normals)
        for each in (field, sources.field(np.append(read, 0.1)) - field)
    )
    assert np.linalg.norm(left) < 0.2 * np.linalg.norm(shown)
    assert np.corrcoef(read, amplitudes[:-1])[0, 1] > 0.8


def test_what_finite_elements_leave_is_learned_as_loads(patients, tmp_path):
    """The field is in equilibrium with the learned load; a millimetre more everywhere moves the face by as much."""
    fitted, metrics = str(tmp_path / "fitted.h5"), {}
    learned = learn_loads(patients, fitted)
    taught = replace(learned, regression=replace(learned.regression, constant=learned.regression.constant + 1.0))
    taught.write(tmp_path / "taught.h5")
    for name, file in (("learned", fitted), ("taught", str(tmp_path / "taught.h5"))):
        predictions = str(tmp_path / f"{name}.h5")
        predict_by("fem_learned:LearnedLoadPredictor", patients[0], predictions, trained=file, fem=CONFIG["fem"])
        metrics[name] = measured(patients[0], predictions, str(tmp_path / f"{name}.csv")).loc[0]
        made = read_prediction(predictions, patients[0].case)
        assert made.converged and made.forces.any()
    assert (metrics["taught"]["eqres_rel"] < 1e-3) and metrics["taught"]["load_rel"] > metrics["learned"][
        "load_rel"
    ] > 0
    model = PatientModel.read(patients[0].model)
    fields = [read_prediction(str(tmp_path / f"{name}.h5"), patients[0].case) for name in metrics]
    face = model.judged_points
    normals = vertex_normals(model.skin_points, model.skin_faces)[face]
    pushed = np.einsum("kx,kx->k", (fields[1].moved_skin(model) - fields[0].moved_skin(model))[face], normals)
    assert 0.5 < np.median(pushed) < 1.5  # a millimetre more at every anchor


def test_what_a_network_leaves_is_learned_as_loads_too(patients, tmp_path):
    """Its weights stay as they are; its corrected field comes near to equilibrium with the load that it declares."""
    network = CONFIG["network"] | {"volume_layers": 1, "boundary_layers": 1, "channels": 8}
    settings = {"network": network, "fem": CONFIG["fem"], "newton_corrections": 3}
    settings["finetuning"] = CONFIG["finetuning"] | {"steps": 0, "sources": True}
    torch.manual_seed(0)
    first = tmp_path / "pretrained.pt"
    save_network(first, build(network_settings(**network)), network_settings(**network))
    last = {"network": str(tmp_path / "network.pt"), "history": str(tmp_path / "finetuning.csv")}
    finetune(
        learner="pinnochio.methods.pinnochio.learner:GraphLearner",
        settings=settings,
        cases=[patient.case for patient in patients],
        models=[patient.model for patient in patients],
        lifts=[],
        plans=[patient.plan for patient in patients],
        postops=[patient.postop for patient in patients],
        covariates=[patient.covariates for patient in patients],
        pretrained=str(first),
        seed=SEED,
        code="x",
        device="cpu",
        outputs=last,
    )
    weights, same = (load_network(path)[0].state_dict() for path in (first, last["network"]))
    assert all(torch.equal(weights[name], same[name]) for name in weights)
    predictions, metrics = str(tmp_path / "predictions.h5"), str(tmp_path / "metrics.csv")
    settings = {"fem": CONFIG["fem"], "newton_corrections": 3}
    predict_by("pinnochio.predictor:GraphPredictor", patients[0], predictions, trained=last["network"], **settings)
    row, made = measured(patients[0], predictions, metrics).loc[0], read_prediction(predictions, patients[0].case)
    assert made.forces.any() and row["load_rel"] > 0
    assert row["eqres_rel"] < 0.1 * row["raw_eqres_rel"]
