"""Training from files to files: it learns, repeats, resumes, and hands over what it learnt."""

import csv
from dataclasses import asdict

import h5py
import numpy as np
import pytest
import torch

from pinnochio.errors import InputError
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.pinnochio.learner import GraphLearner
from pinnochio.methods.pinnochio.patient import tensors
from pinnochio.methods.pinnochio.predictor import GraphPredictor, PatientGraphNetwork, load_network
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.settings import NetworkSettings
from pinnochio.training.case_files import CaseFiles
from pinnochio.training.fold import train_fold
from pinnochio.training.loop import sample_at, schedule
from pinnochio.training.settings import PHASES
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import network_settings, training_settings
from tests.helpers.training import FEM, save_case

SMALL = network_settings(boundary_layers=2, volume_layers=3, rest_layers=1, channels=32, heads=2, decoder_width=32)
SWELLING = 3.0  # mm that the post-operative skin lies above that of the samples


def learner(phase, training):
    return GraphLearner({"network": asdict(SMALL), "fem": FEM, PHASES[phase]: asdict(training)}, phase, "cpu")


def predict(network, settings, model, plan):
    """Displacement and boundary as the network gives them."""
    return PatientGraphNetwork(network, tensors(model, FemSettings(**FEM), settings, "cpu"))(plan)


def smooth_field(model, plan):
    """The rigid motion at the bone, fading with height and towards the cranium and the cut planes."""
    points = model.points
    low, high = points.min(0), points.max(0)
    share = (points - low) / (high - low)
    fade = (1 - 0.5 * share[:, 2]) * (1 - share[:, 0]) ** 2 * 4 * share[:, 1] * (1 - share[:, 1])
    return plan.motion("left").displacement(points) * fade[:, None]


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """Two patients with two finite-element samples each and a post-operative skin."""
    folder, cases = tmp_path_factory.mktemp("cases"), []
    for seed in range(2):
        model, plans = tiny_patient(seed), [tiny_plan(), tiny_plan(x=-2.0, y=1.0, pitch=-3.0)]
        fields = [smooth_field(model, plan) for plan in plans]
        cases.append(save_case(folder, seed, model, plans, fields, SWELLING))
    return cases


def pretrain(cases, folder, steps=8, seed=3, **options):
    training = training_settings(steps, 3e-3, **options)
    out, history = folder / "network.pt", folder / "history.csv"
    phase = learner("pretrain", training)
    train_fold(phase, "pretrain", cases, seed=seed, code="code", out=out, history=history)
    return out, history


def read(history):
    with open(history, newline="") as file:
        return list(csv.DictReader(file))


def weights(path):
    return load_network(path)[0].state_dict()


def same(a, b):
    return all(torch.equal(a[name], b[name]) for name in a)


def test_overfits_one_patient(cases, tmp_path):
    data_alone = {"physics": 0.0, "data": 2.0, "boundary": 1.0}
    with h5py.File(tmp_path / "one.h5", "w") as file, h5py.File(cases[0].fem_samples) as source:
        source.copy("plan_0", file)
    one = CaseFiles("tiny", cases[0].model, fem_samples=tmp_path / "one.h5")
    out, history = pretrain([one], tmp_path, 200, weights=data_alone, mirror=False)
    rows = read(history)
    assert float(rows[-1]["total"]) < 0.01 * float(rows[0]["total"])
    network, settings = load_network(out)
    model, plan = PatientModel.read(one.model), tiny_plan()
    field = smooth_field(model, plan)
    error = predict(network, settings, model, plan)[0] - field
    assert np.linalg.norm(error) < 0.1 * np.linalg.norm(field)


def test_same_seed_same_weights_and_other_seed_others(cases, tmp_path):
    first, again, other = (pretrain(cases, tmp_path / str(i), seed=s)[0] for i, s in enumerate((3, 3, 4)))
    assert same(weights(first), weights(again))
    assert not same(weights(first), weights(other))


def test_finetuning_lowers_the_chamfer_distance(cases, tmp_path):
    pretrained, _ = pretrain(cases, tmp_path, 40)
    training = training_settings(60, 1e-3)
    out, history = tmp_path / "tuned.pt", tmp_path / "tuned.csv"
    phase = learner("finetune", training)
    train_fold(phase, "finetune", cases, pretrained, seed=0, code="code", out=out, history=history)
    values = [float(row["data"]) for row in read(history)]
    assert np.mean(values[-6:]) < 0.5 * np.mean(values[:6])
    assert not same(weights(pretrained), weights(out))


def test_all_terms_are_logged_and_the_physics_weight_rises(cases, tmp_path):
    _, history = pretrain(cases, tmp_path, 8, physics_ramp=0.5)
    rows = read(history)
    assert [int(row["step"]) for row in rows] == list(range(8))
    assert [float(row["physics_weight"]) for row in rows] == [0.25, 0.5, 0.75, 1, 1, 1, 1, 1]
    for row in rows:
        value = {name: float(text) for name, text in row.items()}
        total = 2 * value["data"] + value["boundary"] + value["physics_weight"] * value["physics"]
        assert value["total"] == pytest.approx(total, rel=1e-4)
    assert float(rows[-1]["physics"]) > 0


def test_network_that_names_a_removed_switch_is_read_only_where_the_switch_was_off(cases, tmp_path):
    out, _ = pretrain(cases, tmp_path)
    stored = torch.load(out, weights_only=True)
    for blend in (False, True):
        torch.save(stored | {"network": stored["network"] | NetworkSettings.REMOVED | {"blend": blend}}, out)
        if blend:
            with pytest.raises(InputError, match="blend"):
                load_network(out)
        else:
            assert load_network(out)[1] == SMALL


def test_network_file_holds_settings_and_plain_values_alone(cases, tmp_path):
    out, _ = pretrain(cases, tmp_path)
    stored = torch.load(out, weights_only=True)
    assert network_settings(**stored["network"]) == SMALL and stored["seed"] == 3
    network, settings = load_network(out)
    model = PatientModel.read(cases[0].model)
    first, boundary = predict(network, settings, model, tiny_plan())
    again = GraphPredictor({"fem": FEM, "newton_corrections": 0}, out, "cpu", 1)(Planned("tiny", model, tiny_plan()))
    assert again.forces is None and first.dtype == np.float64 and first.shape == model.points.shape
    assert again.repaired == 0 and again.damping == 1 and again.seconds > 0 and again.setup_seconds > 0
    assert np.array_equal(first, again.displacement) and np.array_equal(boundary, again.boundary)
    inside = (model.node_type == FREE) & (model.interface_kind == 0)
    assert np.array_equal(boundary[inside], first[inside])
    assert not np.array_equal(boundary, first)


def test_prediction_that_is_not_finite_raises(cases, tmp_path):
    network, settings = load_network(pretrain(cases, tmp_path)[0])
    next(network.parameters()).data.fill_(float("nan"))
    with pytest.raises(FloatingPointError, match="tiny"):
        predict(network, settings, PatientModel.read(cases[0].model), tiny_plan())


def test_empty_samples_and_unregistered_skin_name_the_case(cases, tmp_path):
    h5py.File(tmp_path / "none.h5", "w").close()
    with pytest.raises(InputError, match="tiny.*none.h5"):
        pretrain([CaseFiles("tiny", cases[0].model, fem_samples=tmp_path / "none.h5")], tmp_path)
    model = PatientModel.read(cases[0].model)
    PostopSkin(model.points + 200, model.skin_faces, 0.0).write(tmp_path / "far.h5")
    far = CaseFiles("tiny", cases[0].model, plan=cases[0].plan, postop=tmp_path / "far.h5")
    pretrained, training = pretrain(cases, tmp_path, 1)[0], training_settings(1, 1e-3)
    options = {"seed": 0, "code": "code", "out": tmp_path / "o.pt", "history": tmp_path / "h.csv"}
    with pytest.raises(InputError, match="far.h5.*registered"):
        train_fold(learner("finetune", training), "finetune", [far], pretrained, **options)


def test_schedule_and_sample_order():
    values = [schedule(step, training_settings(100, 1e-3, warmup=0.1)) for step in range(100)]
    assert np.argmax(values) == 10 and values[10] == 1 and 0 < values[0] < 0.1 and 0 < values[-1] < 0.01
    assert np.all(np.diff(values[:11]) > 0) and np.all(np.diff(values[10:]) < 0)
    stepped = training_settings(100, 1e-3, warmup=0, decay=0.5, decay_every=0.1, decay_floor=0.1)
    rates = [schedule(step, stepped) for step in range(100)]
    assert rates[:10] == [1] * 10 and rates[10] == 0.5 and rates[30] == 0.125 and min(rates) == rates[-1] == 0.1
    orders = [[sample_at(5 * epoch + i, 5, 1, "x") for i in range(5)] for epoch in range(3)]
    assert all(sorted(order) == list(range(5)) for order in orders) and len(set(map(tuple, orders))) > 1
