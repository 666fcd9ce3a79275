"""The muscle layer of segmentations without one: the rule, its agreement with labelled muscles, and a single layer."""

from functools import partial

import numpy as np
import pytest
from scipy import ndimage

from pinnochio.errors import InputError
from pinnochio.importing.muscle_layer import derive_muscle, muscle_layer
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.simulation import simulate
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.metrics.validity import volume_metrics
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL, segment_code
from pinnochio.model.patient import BONE_SUPERFICIAL, FREE, MOVING, NO_INTERFACE, SLIDING
from pinnochio.model.surfaces import bone_surface, skin_surface
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.virtual.procedures import DEFORMITIES
from tests.helpers.settings import fem_settings
from tests.helpers.virtual_heads import virtual_head

SPACING = np.array([2.0, 1.0, 1.0])
FEM = fem_settings()


def slab():
    """Bone behind 20 mm of tissue, skin in front; a mouth (air) in the bone; [ix, iy, iz] of SPACING mm."""
    labels = np.zeros((40, 40, 60), np.uint8)
    labels[:, 10:30] = SUPERFICIAL
    labels[:, 30:] = segment_code(0)
    labels[:, :, 50:][labels[:, :, 50:] > SUPERFICIAL] = CRANIUM
    labels[20:30, 20:38, 20:30] = AIR
    return labels


def test_the_layer_lies_where_the_rule_says():
    labels = slab()
    muscle = derive_muscle(labels, SPACING, np.array([0.0, -100.0, 7.0]), top=50.0)
    assert (labels[muscle] == SUPERFICIAL).all()
    assert np.flatnonzero(muscle[5, :, 5]).tolist() == list(range(20, 30))  # the half at the bone
    top = np.flatnonzero(muscle[5, 29])
    assert top.max() == 42 and 7 + top.max() < 50 <= 7 + top.max() + 1
    # The mouth, and one voxel of 2 mm on either side.
    assert np.flatnonzero(~muscle[:, 25, 25]).tolist() == list(range(19, 31))


def test_thin_tissue_has_no_muscle_in_its_skin():
    labels = slab()
    labels[:, :26] = AIR  # 4 mm of tissue are left; one layer of the half at the bone is 3 mm below the skin
    muscle = derive_muscle(labels, SPACING, np.zeros(3), top=50.0)
    assert np.flatnonzero(muscle[5, :, 5]).tolist() == [29]


def test_crumbs_are_no_muscle():
    labels = slab()
    labels[:, :, :50] = AIR
    labels[2:6, 10:30, 3:8], labels[2:6, 30:33, 3:8] = SUPERFICIAL, segment_code(0)
    assert not derive_muscle(labels, SPACING, np.zeros(3), top=50.0).any()
    with pytest.raises(InputError, match="'P1': head.nii.gz.*no tissue fits the rule.*single"):
        muscle_layer(labels, SPACING, np.zeros(3), 50.0, "derived", "P1", "head.nii.gz")


def test_the_word_says_where_the_layer_comes_from():
    labels = slab()
    rule = partial(muscle_layer, spacing=SPACING, origin=np.zeros(3), top=50.0, case="P1", file="head.nii.gz")
    single, word = rule(labels, unlabelled="single")
    assert word == "single" and (single == labels).all()
    derived, word = rule(labels, unlabelled="derived")
    assert word == "derived" and derived.dtype == np.uint8
    expected = derive_muscle(labels, SPACING, np.zeros(3), top=50.0)
    assert ((derived == MUSCLE) == expected).all() and (derived != labels).sum() > 1000
    again, word = rule(derived, unlabelled="refuse")
    assert word == "labelled" and again.tobytes() == derived.tobytes()
    with pytest.raises(InputError, match="'P1': head.nii.gz: no muscle is labelled.*unlabelled_muscle"):
        rule(labels, unlabelled="refuse")


@pytest.fixture(scope="module")
def heads():
    """Four virtual heads at 2 mm."""
    return [virtual_head(deformity) for deformity in DEFORMITIES]


def upper_top(head):
    layers = np.flatnonzero((head.labels == segment_code(0)).any(axis=(0, 1)))
    return head.origin[2] + head.spacing[2] * layers.max()


def without_muscle(head):
    return np.where(head.labels == MUSCLE, SUPERFICIAL, head.labels).astype(np.uint8)


def test_the_layer_resembles_the_muscles_of_virtual_heads(heads):
    """Dice 0.54 to 0.61 and volume ratio 0.70 to 1.13; chance would give a Dice of 0.2."""
    for head in heads:
        derived, _ = muscle_layer(
            without_muscle(head), head.spacing, head.origin, upper_top(head), "derived", "V", "v.nii.gz"
        )
        muscle, truth = derived == MUSCLE, head.labels == MUSCLE
        assert 2 * (muscle & truth).sum() / (muscle.sum() + truth.sum()) > 0.5
        assert 0.65 < muscle.sum() / truth.sum() < 1.4
        assert ndimage.label(np.isin(derived, (SUPERFICIAL, MUSCLE)))[1] == 1


def test_a_single_layer_runs_through_interfaces_and_finite_elements(heads):
    head = heads[1]
    labels, word = muscle_layer(without_muscle(head), head.spacing, head.origin, 0.0, "single", "V", "v.nii.gz")
    grid = head.spacing, head.origin
    bone = bone_surface(labels, *grid, head.segments, 6.0)
    mesh = tetrahedralize(labels, *grid, 1000)
    patient = label_interfaces(mesh, labels, *grid, head.segments, bone, skin_surface(labels, *grid))
    assert (patient.tissue == SUPERFICIAL).all() and word == "single"
    assert set(np.unique(patient.interface_kind)) == {NO_INTERFACE, BONE_SUPERFICIAL}
    assert all((patient.node_type == kind).sum() > 10 for kind in (FREE, MOVING, SLIDING))
    plan = Plan("V", {"mandible_distal": RigidMotion(translation=np.array([0.0, 2.0, 0.0]))})
    (result,) = simulate(patient, [plan], FEM)
    assert result.converged and jacobians(patient.points, patient.cells, result.displacement).min() > 0
    assert result.displacement[:, 1].max() > 1.9
    metrics = volume_metrics(patient.points, patient.cells, patient.tissue, result.displacement)
    assert np.isnan(metrics["volume_change_muscle"]) and abs(metrics["volume_change_superficial"]) < 1
