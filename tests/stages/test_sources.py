"""Faces that are held where scans say: what they hold of a known pattern is found again, and a load is declared."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.solvers.newton_corrections import EQUILIBRIUM
from pinnochio.methods.pinnochio.predictor import GraphPredictor, load_network
from pinnochio.methods.protocol import Planned
from pinnochio.methods.sources import PatientSources, fit
from pinnochio.model.face_modes import FaceModes
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.networks.building import build
from pinnochio.plans.plan import Plan
from pinnochio.training.checkpoint import save_network
from scripts.training.finetune import finetune
from tests.helpers.settings import CONFIG, SEED, network_settings
from tests.helpers.training import learn_loads, measured, predict_by, save_random


@pytest.fixture(scope="module")
def faces(patients):
    """Two patients' models and plans."""
    models = [PatientModel.read(files.model) for files in patients]
    return models, [Plan.read(files.plan, files.case) for files in patients]


def learned(patients, faces, away):
    """The model of skins that lie off bases that are zero by so many mm (k, 3) of the judged face."""
    models = faces[0]
    skins = []
    for head, shift in zip(models, away, strict=True):
        moved = head.skin_points.copy()
        moved[head.judged_points] += shift
        skins.append((moved, head.skin_faces))
    return fit(models, [0 * head.points for head in models], skins)


def normals_of(head):
    return vertex_normals(head.skin_points, head.skin_faces)[head.judged_points]


def test_nothing_is_learned_where_nothing_deviates(patients, faces):
    model = learned(patients, faces, [np.zeros((len(head.judged_points), 3)) for head in faces[0]])
    assert np.abs(model.amplitudes).max() < 1e-9 and model.largest < 1e-9


def test_a_broad_pattern_of_everyone_is_learned(patients, faces):
    """And no point is wanted farther off than in the training patients, however large the amplitudes are."""
    modes = FaceModes.of(faces[0])
    wanted = [modes(head)[:, [0, 2, 3]] @ [0.6, 0.3, -0.4] for head in faces[0]]
    away = [one[:, None] * normals_of(head) for one, head in zip(wanted, faces[0], strict=True)]
    model = learned(patients, faces, away)
    wild = replace(model, amplitudes=100 * model.amplitudes)
    for one, head in zip(wanted, faces[0], strict=True):
        shown = np.einsum("kx,kx->k", PatientSources(model, head)(0 * head.points), normals_of(head))
        assert np.corrcoef(shown, one)[0, 1] > 0.9
        far = PatientSources(wild, head)(0 * head.points)
        assert np.linalg.norm(far, axis=1).max() == pytest.approx(model.largest)


def test_skin_that_follows_less_is_learned_in_all_directions(patients, faces):
    """Scans show how far skin lies out alone; that it follows less shows in how it moves along itself too."""
    solved = [simulate(head, [plan], patients[0].fem, linear=True)[0] for head, plan in zip(*faces, strict=True)]
    bases, skins = [each.displacement for each in solved], []
    for head, base in zip(faces[0], bases, strict=True):
        points = head.skin_points.copy()
        points[head.judged_points] += 0.7 * (head.onto_judged @ base)
        skins.append((points, head.skin_faces))
    model = fit(faces[0], bases, skins)
    for head, base in zip(faces[0], bases, strict=True):
        less = 0.3 * (head.onto_judged @ base)
        assert np.linalg.norm(PatientSources(model, head)(base) + less) < 0.7 * np.linalg.norm(less)


def test_what_finite_elements_leave_is_learned(patients, tmp_path):
    """The field is in equilibrium with the learned load; a millimetre more of a pattern moves the face so."""
    fitted, metrics = str(tmp_path / "fitted.h5"), {}
    learned = learn_loads(patients, fitted)
    amplitudes = learned.amplitudes + np.eye(len(learned.amplitudes))[0]  # the broadest pattern
    taught = replace(learned, amplitudes=amplitudes, largest=5.0)
    taught.write(tmp_path / "taught.h5")
    for name, file in (("learned", fitted), ("taught", str(tmp_path / "taught.h5"))):
        predictions = str(tmp_path / f"{name}.h5")
        predict_by("fem_learned:LearnedLoadPredictor", patients[0], predictions, trained=file, fem=CONFIG["fem"])
        metrics[name] = measured(patients[0], predictions, str(tmp_path / f"{name}.csv")).loc[0]
        made = read_prediction(predictions, patients[0].case)
        assert made.converged and (made.forces.any() or name == "learned")
    assert metrics["taught"]["eqres_rel"] < 1e-3
    assert metrics["taught"]["load_rel"] > metrics["learned"]["load_rel"] >= 0
    model = PatientModel.read(patients[0].model)
    fields = [read_prediction(str(tmp_path / f"{name}.h5"), patients[0].case) for name in metrics]
    moved = (fields[1].moved_skin(model) - fields[0].moved_skin(model))[model.judged_points]
    pushed = np.einsum("kx,kx->k", moved, normals_of(model))
    assert 0.7 < np.median(pushed) < 1.1  # the broadest pattern is a millimetre everywhere


def test_what_a_network_leaves_is_learned_too(patients, tmp_path):
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
        **{f"{name}s": [getattr(each, name) for each in patients] for name in ("case", "model", "plan", "postop")},
        lifts=[],
        covariates=[patient.covariates for patient in patients],
        pretrained=str(first),
        seed=SEED,
        code="x",
        device="cpu",
        outputs=last,
    )
    weights, same = (load_network(path)[0].state_dict() for path in (first, last["network"]))
    assert all(torch.equal(weights[name], same[name]) for name in weights)
    taught = torch.load(last["network"], weights_only=True)
    taught["sources"]["amplitudes"][0] += 1.0  # mm of the broadest pattern
    taught["sources"]["largest"] += 5.0
    torch.save(taught, last["network"])
    predictions, metrics = str(tmp_path / "predictions.h5"), str(tmp_path / "metrics.csv")
    settings = {"fem": CONFIG["fem"], "newton_corrections": 3}
    predict_by("pinnochio.predictor:GraphPredictor", patients[0], predictions, trained=last["network"], **settings)
    row, made = measured(patients[0], predictions, metrics).loc[0], read_prediction(predictions, patients[0].case)
    assert made.forces.any() and row["load_rel"] > 0
    assert row["eqres_rel"] < EQUILIBRIUM


def test_networks_that_share_a_patient_keep_what_each_has_learned(patients, faces, tmp_path):
    """As those of all folds do: one patient is read for all of them."""
    (head, _), (plan, _), state = *faces, learn_loads(patients, str(tmp_path / "fitted.h5")).state()
    planned, skins = Planned(patients[0].case, head, plan), []
    for number in (0, 1):
        taught = state | {"amplitudes": state["amplitudes"] + number * np.eye(len(state["amplitudes"]))[0]}
        sources = {name: torch.as_tensor(value) for name, value in (taught | {"largest": np.array(5.0)}).items()}
        file = save_random(
            tmp_path / f"{number}.pt",
            network_settings(**CONFIG["network"] | {"volume_layers": 1, "boundary_layers": 1, "channels": 8}),
            sources=sources,
        )
        predict = GraphPredictor({"fem": CONFIG["fem"], "newton_corrections": 0}, file, "cpu", 1)
        skins.append(head.moved_skin(predict(planned).displacement))
    assert np.abs(skins[1] - skins[0]).max() > 0.01
