"""The cascade: what it sees, where it starts, and what it must not depend on."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pinnochio.mechanics.elements.materials import neo_hookean
from pinnochio.mechanics.lift import make_lift
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.model.patient import FIXED, NO_INTERFACE, SLIDING
from pinnochio.networks.building import build
from tests.helpers.patients import renumbered, tiny_patient, tiny_plan
from tests.helpers.settings import network_settings

SMALL = network_settings(boundary_layers=2, volume_layers=2, rest_layers=1, channels=16, heads=2, decoder_width=16)
TISSUES = replace(SMALL, volume="tissues")
LIFTED = replace(SMALL, lift="elastic", volume_layers=0)


def tensors(model, neighbours=8, **switches):
    material = neo_hookean(model.tissue, {MUSCLE: 6.0, SUPERFICIAL: 4.0}, 0.49, 0)
    settings = replace(SMALL, neighbours=neighbours, **switches)
    lift = None if settings.lift == "none" else make_lift(model, material, controls=10)
    return PatientTensors.build(model, material, "patch", settings, lift)


def shaken(settings=SMALL, seed=0):
    """A network whose zero-initialised last layers are filled, so that it does something."""
    torch.manual_seed(seed)
    network = build(settings)
    for name, weight in network.named_parameters():
        if weight.abs().max() == 0:
            torch.nn.init.normal_(weight, std=0.3)
        assert weight.abs().max() > 0, name
    return network


@pytest.mark.parametrize("form", [{}, {"volume": "tissues"}, {"decomposition": False}])
def test_untrained_network_moves_nothing_and_returns_the_cue(form):
    patient, plan = tensors(tiny_patient()), tiny_plan()
    network = build(replace(SMALL, **form))
    prediction = network(patient.anatomy, patient.signal(plan))
    assert prediction.displacement.abs().max() == 0
    cue, reliable = patient.model.reference_cue(plan)
    assert np.allclose(prediction.boundary.detach().numpy(), cue, atol=1e-5)
    assert np.abs(cue[reliable]).max() > 1
    assert (patient.operator.jacobians(prediction.displacement) - 1).abs().max() < 1e-6


@pytest.mark.parametrize("form", [{}, {"volume": "tissues"}, {"decomposition": False}])
def test_prediction_follows_a_renumbering_of_the_nodes(form):
    model, plan = tiny_patient(), tiny_plan()
    order = np.random.default_rng(0).permutation(len(model.points))
    network = shaken(replace(SMALL, **form))
    results = []
    for each in (model, renumbered(model, order)):
        patient = tensors(each)
        results.append(network(patient.anatomy, patient.signal(plan)).displacement.detach().numpy())
    assert np.abs(results[0]).max() > 0.1
    assert np.allclose(results[0][order], results[1], atol=1e-4)


def test_mirrored_pass_equals_mirrored_patient():
    model, plan = tiny_patient(), tiny_plan()
    flip = np.array([-1.0, 1.0, 1.0])
    patient = tensors(model)
    signal = patient.signal(plan)
    flipped = {"points": model.points * flip, "bone_points": model.bone_points * flip}
    twin = tensors(replace(model, **flipped, cells=model.cells[:, [0, 2, 1, 3]]))
    mirrored = torch.tensor(flip, dtype=torch.float32)
    twin_signal = replace(signal, bone=signal.bone * mirrored, cue=signal.cue * mirrored)
    network = shaken()
    direct = network(patient.anatomy, signal, mirror=True).displacement
    assert torch.allclose(direct, network(twin.anatomy, twin_signal).displacement * mirrored, atol=1e-4)
    assert not torch.allclose(direct, network(patient.anatomy, signal).displacement, atol=1e-2)


def test_neighbours_are_the_nearest_source_nodes():
    model = tiny_patient()
    anatomy = tensors(model, neighbours=5).anatomy
    sources = {name: model.bone_points for name in ("bone_muscle", "bone_superficial")}
    sources["muscle_superficial"] = model.points[anatomy.muscle_nodes.numpy()]
    for name, source in sources.items():
        link = getattr(anatomy, name)
        assert len(link.nodes)
        for node, near in zip(link.nodes.tolist(), link.neighbours.tolist(), strict=True):
            distance = np.linalg.norm(source - model.points[node], axis=1)
            assert set(near) == set(np.argsort(distance)[:5])


@pytest.mark.parametrize("settings", [SMALL, TISSUES], ids=["whole", "tissues"])
def test_volume_networks_see_zero_on_free_nodes_and_the_mask_on_interfaces(settings):
    patient, plan = tensors(tiny_patient()), tiny_plan()
    network, seen = shaken(settings), {}
    parts = {"whole.volume": np.arange(len(patient.points))}
    if settings is TISSUES:
        parts = {name: getattr(patient.anatomy, f"{name}_nodes").numpy() for name in ("muscle", "superficial")}
    for name in parts:
        network.get_submodule(name).register_forward_pre_hook(lambda _, inputs, name=name: seen.update({name: inputs}))
    prediction = network(patient.anatomy, patient.signal(plan))
    model = patient.model
    fixed = (model.node_type == FIXED) & (model.interface_kind == NO_INTERFACE)
    bone = np.isin(model.interface_kind, (1, 2))
    every = fixed | (model.interface_kind > 0)
    known = {"muscle": fixed | bone, "superficial": every, "whole.volume": every}
    assert seen.keys() == parts.keys()
    for name, (_, _, sparse, mask) in seen.items():
        expected = known[name][parts[name]]
        assert np.array_equal(mask[:, 0].numpy() > 0, expected)
        sparse = sparse.detach().abs().sum(1).numpy()
        assert (sparse[~expected] == 0).all() and (sparse[expected] > 0).any()
    assert np.array_equal(prediction.known[:, 0].numpy() > 0, every)
    assert prediction.boundary.detach().numpy()[fixed].any() == 0
    assert (model.node_type == SLIDING).any()
    assert np.abs(prediction.boundary.detach().numpy()[model.node_type == SLIDING]).min() > 0


def test_shared_nodes_take_the_mean_of_both_tissues():
    patient, plan = tensors(tiny_patient()), tiny_plan()
    network, outputs = shaken(TISSUES), {}
    for name in ("muscle", "superficial"):
        network.get_submodule(name).register_forward_hook(lambda *a, name=name: outputs.update({name: a[2]}))
    whole = network(patient.anatomy, patient.signal(plan)).displacement
    fields = torch.full((2, *whole.shape), torch.nan)
    fields[0, patient.anatomy.muscle_nodes] = outputs["muscle"]
    fields[1, patient.anatomy.superficial_nodes] = outputs["superficial"]
    assert torch.isfinite(fields).all(0).all(1).sum() > 5
    assert torch.allclose(whole, fields.nanmean(0), atol=1e-6)


@pytest.mark.parametrize(("settings", "part"), [(SMALL, "whole.volume"), (TISSUES, "superficial")])
def test_patient_without_muscle_is_solved(settings, part):
    model = tiny_patient()
    kind = np.array([0, 2, 2, 0], np.int8)[model.interface_kind]
    model = replace(model, tissue=np.full_like(model.tissue, SUPERFICIAL), interface_kind=kind)
    patient, network, outputs = tensors(model), shaken(settings), []
    network.get_submodule(part).register_forward_hook(lambda *a: outputs.append(a[2]))
    displacement = network(patient.anatomy, patient.signal(tiny_plan())).displacement
    assert sorted(patient.anatomy.superficial_nodes.tolist()) == list(range(len(model.points)))
    assert torch.equal(displacement[patient.anatomy.superficial_nodes], outputs[0])
    assert displacement.abs().min() > 0
    displacement.square().sum().backward()
    gradients = [weight.grad for weight in network.get_submodule(part).parameters() if weight.grad is not None]
    assert all(torch.isfinite(gradient).all() for gradient in gradients) and any(map(torch.any, gradients))


@pytest.mark.parametrize("volume_layers", [0, 2])
def test_untrained_network_with_a_lift_returns_the_lift(volume_layers):
    patient, plan = tensors(tiny_patient(), lift="elastic"), tiny_plan()
    signal = patient.signal(plan)
    network = build(replace(SMALL, lift="elastic", volume_layers=volume_layers))
    prediction = network(patient.anatomy, signal)
    assert torch.allclose(prediction.displacement, signal.lifted, atol=1e-5)
    assert torch.allclose(prediction.boundary, signal.lifted * prediction.known, atol=1e-5)
    sliding = patient.model.node_type == SLIDING
    assert signal.cue[sliding].abs().max() > 0.1 and signal.reliable[sliding].max() == 0


def test_interface_with_a_lift_moves_the_volume_and_only_by_the_interface():
    patient, plan = tensors(tiny_patient(), lift="elastic"), tiny_plan()
    signal, network = patient.signal(plan), shaken(LIFTED)
    prediction = network(patient.anatomy, signal)
    added = (prediction.displacement - signal.lifted).detach().numpy()
    assert np.abs(added).max() > 0.1
    known = prediction.known[:, 0].numpy() > 0
    assert torch.allclose(prediction.displacement[known], prediction.boundary[known], atol=1e-5)
    moved = (added.reshape(1, -1) @ np.linalg.pinv(patient.lift.departures.reshape(30, -1))).reshape(30, 1, 1)
    assert np.allclose((moved * patient.lift.departures).sum(0), added, atol=1e-3)


def test_mirrored_pass_through_a_lift_equals_the_mirrored_patient():
    model, plan = tiny_patient(), tiny_plan()
    flip = torch.tensor([-1.0, 1.0, 1.0])
    patient = tensors(model, lift="elastic")
    signal, network = patient.signal(plan), shaken(LIFTED)
    mirrored = network(patient.anatomy, signal, mirror=True).displacement
    # The same network on the mirrored patient: everything it reads is mirrored, the departures too.
    anatomy = patient.anatomy
    departures = anatomy.lift.departures.view(-1, 3, len(model.points), 3) * flip[None, :, None, None] * flip
    twin = replace(
        anatomy,
        bone=anatomy.bone.mirrored(flip),
        lift=replace(anatomy.lift, departures=departures.reshape(anatomy.lift.departures.shape)),
    )
    twin_signal = replace(signal, bone=signal.bone * flip, cue=signal.cue * flip, lifted=signal.lifted * flip)
    assert torch.allclose(mirrored, network(twin, twin_signal).displacement * flip, atol=1e-4)


def test_settings_refuse_what_cannot_be_built():
    with pytest.raises(ValueError, match="multiple of heads"):
        network_settings(channels=10, heads=4)
    with pytest.raises(ValueError, match="lift"):
        network_settings(lift="sideways")
    with pytest.raises(ValueError, match="interface to lift"):
        network_settings(decomposition=False, lift="elastic")
    with pytest.raises(ValueError, match="choose a lift"):
        network_settings(volume_layers=0)
    with pytest.raises(ValueError, match="lift is 'none'"):
        PatientTensors.build(
            *(tiny_patient(), None, "patch"), settings=SMALL, lift=tensors(tiny_patient(), lift="elastic").lift
        )
