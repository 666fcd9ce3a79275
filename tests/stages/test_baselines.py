"""The systems that the study compares with, from a patient's files to rows of the table."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.methods.pinnochio.predictor import load_network
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.networks.building import build
from pinnochio.training.checkpoint import save_network
from scripts.tables.evaluate import evaluate
from scripts.training.finetune import finetune
from scripts.training.fit import fit
from scripts.training.pretrain import pretrain
from tests.helpers.settings import CONFIG, SEED, network_settings
from tests.helpers.training import learn_loads, predict_by


def measured(patient, predictions, metrics):
    labels = {"fold": "1", "method": "some", "code": "x"}
    evaluate(
        [patient.case], predictions, [patient.model], [patient.plan], {patient.case: patient.postop},
        {patient.case: patient.judged}, [patient.true_motion], patient.fem, labels, SEED, metrics,
    )  # fmt: skip
    return pd.read_csv(metrics).loc[0]


@pytest.mark.parametrize("architecture", ["acmt", "dgcfp"])
def test_a_surface_network_from_fields_and_skin_to_a_row_of_the_table(patient, tmp_path, architecture):
    phase = CONFIG["surface"]["networks"][architecture]["finetuning"] | {"steps": 3, "batch": 2}
    settings = {"network": {"architecture": architecture, "points": 64, "neighbours": 8, "repeats": 1}}
    settings |= {"pretraining": phase, "finetuning": phase}
    first, last = ({name: str(tmp_path / f"{phase}_{name}") for name in ("network", "history")} for phase in "ab")
    common = {
        "learner": "pinnochio.methods.surface.learner:SurfaceLearner",
        "settings": settings,
        "code": "x",
        "device": "cpu",
    }
    common |= {"cases": [patient.case], "models": [patient.model], "lifts": []}
    pretrain(**common, fem_samples=[patient.fem_samples], seed=1, outputs=first)
    outcome = {"plans": [patient.plan], "postops": [patient.postop], "covariates": [], "pretrained": first["network"]}
    finetune(**common, **outcome, seed=2, outputs=last)
    predictions, metrics = str(tmp_path / "predictions.h5"), str(tmp_path / "metrics.csv")
    predict_by("surface.predictor:SurfacePredictor", patient, predictions, trained=last["network"])
    row = measured(patient, predictions, metrics)
    assert row["cd"] > 0 and row["skin_error_mean"] > 0 and row["seconds"] > 0
    assert row[["min_jacobian", "eqres_rel", "volume_error_mean", "moving_error", "eqres_element"]].isna().all()


def test_what_finite_elements_leave_is_learned_as_loads(patients, tmp_path):
    """The field is in equilibrium with the learned load; a millimetre more everywhere moves the face by as much."""
    fitted, metrics = str(tmp_path / "fitted.h5"), {}
    learned = learn_loads(patients, fitted)
    taught = replace(learned, regression=replace(learned.regression, constant=learned.regression.constant + 1.0))
    taught.write(tmp_path / "taught.h5")
    for name, file in (("learned", fitted), ("taught", str(tmp_path / "taught.h5"))):
        predictions = str(tmp_path / f"{name}.h5")
        predict_by("fem_learned:LearnedLoadPredictor", patients[0], predictions, trained=file, fem=CONFIG["fem"])
        metrics[name] = measured(patients[0], predictions, str(tmp_path / f"{name}.csv"))
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
    row, made = measured(patients[0], predictions, metrics), read_prediction(predictions, patients[0].case)
    assert made.forces.any() and row["load_rel"] > 0
    assert row["eqres_rel"] < 0.1 * row["raw_eqres_rel"]


def test_floors_need_no_network(patient, tmp_path):
    fitted, rows = str(tmp_path / "fitted.h5"), {}
    fit(
        learner="pinnochio.methods.pca_linear:fit",
        cases=[patient.case],
        models=[patient.model],
        fem_samples=[patient.fem_samples],
        plans=[patient.plan],
        postops=[patient.postop],
        covariates=[],
        settings={},
        fitted=fitted,
    )
    classes = {"ratio": "Ratio", "pca_linear": "Pca", "elastic": "Elastic", "no_change": "NoChange"}
    for name, start in classes.items():
        predict_by(f"{name}:{start}Predictor", patient, str(tmp_path / f"{name}.h5"), trained=fitted, fem=CONFIG["fem"])
        rows[name] = measured(patient, str(tmp_path / f"{name}.h5"), str(tmp_path / f"{name}.csv"))
    for name, most in (("ratio", 1.0), ("elastic", 0.8)):
        assert rows[name]["skin_error_mean"] < most * rows["no_change"]["skin_error_mean"], name
    assert rows["elastic"]["min_jacobian"] > 0 and rows["elastic"]["setup_seconds"] > rows["elastic"]["seconds"]
    assert rows["elastic"]["moving_error"] < 1e-6 < rows["no_change"]["moving_error"]
    assert np.isnan(rows["ratio"]["min_jacobian"])
