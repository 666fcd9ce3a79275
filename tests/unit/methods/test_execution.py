"""What a patient's execution error explains of its skin, and what all patients share."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pinnochio.mechanics.lift import make_lift
from pinnochio.mechanics.materials import neo_hookean
from pinnochio.methods.pinnochio.execution import execution_fields, motion_field
from pinnochio.methods.pinnochio.losses import SurfaceLoss
from pinnochio.methods.pinnochio.patient import PatientTensors
from pinnochio.model.labels import MUSCLE, SUPERFICIAL
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.plans.sampling import EXECUTION
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import network_settings

SETTINGS = network_settings(lift="elastic", volume_layers=0)
MODEL = tiny_patient()
MATERIAL = neo_hookean(MODEL.tissue, {MUSCLE: 6.0, SUPERFICIAL: 4.0}, 0.49, 0)
LIFT = make_lift(MODEL, MATERIAL, "elastic", controls=6)
PATIENT = PatientTensors.build(MODEL, MATERIAL, "patch", SETTINGS, LIFT)


def sample(shift):
    """The patient whose segment was carried `shift` (3,) mm beside the plan."""
    plan = tiny_plan()
    motion = plan.motions["left"]
    executed = Plan("tiny", {"left": RigidMotion(motion.rotation, motion.translation + shift, motion.pivot)})
    skin = MODEL.moved_skin(PATIENT.signal(executed).lifted.numpy().astype(float))
    return PATIENT, PATIENT.signal(plan), SurfaceLoss(PATIENT, skin, MODEL.skin_faces, 2000)


def test_motion_field_is_the_lift_of_a_small_rigid_motion():
    errors = torch.tensor([[0.5, -1.0, 0.3, 0.2, -0.1, 0.3]])
    size = np.sqrt((EXECUTION**2).sum(axis=1))
    middle = MODEL.bone_points[MODEL.bone_segment == 0].mean(axis=0)
    scaled = errors.numpy()[0] * size
    motion = RigidMotion.from_degrees(scaled[3:], scaled[:3], middle)
    rigid = PATIENT.signal(Plan("tiny", {"left": motion})).lifted
    field = motion_field(PATIENT, errors)
    assert rigid.abs().max() > 0.5 and torch.allclose(field, rigid, atol=0.02)


@pytest.mark.parametrize("shift", [[0, 0, 2.0], [0, 2.0, -1.0]])
def test_opposite_errors_are_explained(shift):
    samples = [sample(np.array(shift)), sample(-np.array(shift))]
    fields = execution_fields(samples, 0.002, seed=0)
    for (_, signal, surface), field in zip(samples, fields, strict=True):
        before = surface(signal.lifted, np.random.default_rng(1)).item()
        after = surface(signal.lifted + field, np.random.default_rng(1)).item()
        assert before > 0.3 and after < 0.5 * before
    assert torch.allclose(fields[0], -fields[1], atol=1e-4)


def test_what_all_patients_share_is_no_error():
    fields = execution_fields([sample(np.array([0, 0, 2.0]))] * 2, 0.002, seed=0)
    assert max(field.abs().max() for field in fields) < 0.2


def test_patients_with_other_segments_share_the_errors_of_the_same_bone():
    """One patient with one segment, one with two: the maxillae have a mean, the mandible has nobody to compare with."""
    nodes = np.where((MODEL.node_segment == 0) & (MODEL.points[:, 1] > -70), 1, MODEL.node_segment).astype(np.int8)
    bone = np.where((MODEL.bone_segment == 0) & (MODEL.bone_points[:, 1] > -70), 1, MODEL.bone_segment).astype(np.int8)
    whole = replace(MODEL, segments=("lefort1",))
    parts = replace(MODEL, segments=("lefort1_left", "mandible"), node_segment=nodes, bone_segment=bone)
    samples = []
    for model in (whole, parts):
        patient = PatientTensors.build(
            model, MATERIAL, "patch", SETTINGS, make_lift(model, MATERIAL, "elastic", controls=6)
        )
        plan = Plan("tiny", dict.fromkeys(model.segments, tiny_plan().motions["left"]))
        shifted = {name: replace(own, translation=own.translation + [0, 0, 2.0]) for name, own in plan.motions.items()}
        skin = model.moved_skin(patient.signal(Plan("tiny", shifted)).lifted.numpy().astype(float))
        samples.append((patient, patient.signal(plan), SurfaceLoss(patient, skin, model.skin_faces, 2000)))
    one, two = execution_fields(samples, 0.002, seed=0)
    assert one.shape == two.shape and max(one.abs().max(), two.abs().max()) < 1.0  # both were 2 mm off: shared
    apart = execution_fields([sample(np.array([0, 0, 2.0])), samples[1]], 0.002, seed=0)
    assert apart[0].abs().max() < 1e-6  # nobody else has its bone


def test_a_dear_error_explains_little():
    samples = [sample(np.array([0, 0, 2.0])), sample(np.array([0, 0, -2.0]))]
    cheap, dear = (execution_fields(samples, prior, seed=0)[0].norm() for prior in (0.002, 10.0))
    assert dear < 0.2 * cheap
