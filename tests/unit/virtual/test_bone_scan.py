"""The scan of the bones after surgery: where they are, what is added and taken, and that the seed decides it."""

import numpy as np
import pytest
from scipy import ndimage

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.importing.segmentation import Segmentation
from pinnochio.model.labels import CRANIUM, segment_code
from pinnochio.plans.plan import Plan
from pinnochio.virtual.bone_scan import ANGLE, SPACING, plate_sites, scan_bones
from tests.helpers.virtual_heads import virtual_head

MOVED = Plan("P1", {"mandible_distal": RigidMotion.from_degrees((3, 0, 1), (0, -8, 2), (0, -60, -60))})


@pytest.fixture(scope="module")
def head():
    made = virtual_head("class_ii")
    return Segmentation(made.labels, made.spacing, made.origin, made.segments)


@pytest.fixture(scope="module")
def clean(head):
    return scan_bones(head, MOVED, np.random.default_rng(5), 0.0)


def places(scan, value=None):
    """Voxels of bone (or of one label) in the scanner's frame, mm."""
    chosen = scan.labels > 0 if value is None else scan.labels == value
    return np.argwhere(chosen) * scan.spacing + scan.origin


def test_a_clean_scan_shows_every_bone_where_it_was_moved(head, clean):
    volume = (head.labels >= CRANIUM).sum() * head.spacing.prod()
    assert (clean.labels > 0).sum() * clean.spacing.prod() == pytest.approx(volume, rel=0.05)
    assert SPACING[0] <= clean.spacing[0] <= SPACING[1]
    for index, name in ((-1, "cranium"), (1, "mandible_distal"), (2, "proximal_left")):
        inside = np.argwhere(ndimage.binary_erosion(head.labels == segment_code(index))) * head.spacing + head.origin
        moved = clean.frame.apply(MOVED.motion(name).apply(inside))
        voxel = np.round((moved - clean.origin) / clean.spacing).astype(int)
        assert (clean.labels[tuple(voxel.T)] > 0).mean() > 0.99, name


def test_the_frame_is_that_of_the_scanner(clean):
    assert 1 < np.linalg.norm(clean.frame.degrees) <= ANGLE


def test_the_seed_decides_and_labels_are_few(head):
    one, same, other = (scan_bones(head, MOVED, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one.labels, same.labels) and np.array_equal(one.origin, same.origin)
    assert not np.array_equal(one.origin, other.origin)
    single, two = (scan_bones(head, MOVED, np.random.default_rng(seed), 0) for seed in (0, 1))
    assert (single.labels.max(), two.labels.max()) == (1, 2)
    jaw = np.isin(head.labels, [segment_code(i) for i in (1, 2, 3)]).sum() * head.spacing.prod()
    assert (two.labels == 2).sum() * two.spacing.prod() == pytest.approx(jaw, rel=0.1)


def test_artefacts_roughen_add_and_take(head, clean):
    """The same frame and grid but for the field of view: metal and callus outside of bone, noise at its surface."""
    scan = scan_bones(head, MOVED, np.random.default_rng(5), 1.0)
    assert np.array_equal(scan.frame.rotation, clean.frame.rotation)
    assert scan.labels.shape[2] < clean.labels.shape[2]
    assert (scan.labels[:, :, -1] > 0).any() and not (clean.labels[:, :, -1] > 0).any()
    shared = tuple(map(slice, np.minimum(scan.labels.shape, clean.labels.shape)))
    bone, truth = scan.labels[shared] > 0, clean.labels[shared] > 0
    away = ndimage.distance_transform_edt(~truth, clean.spacing)
    depth = ndimage.distance_transform_edt(truth, clean.spacing)
    assert away[bone].max() > 1.5 and depth[~bone].max() > 1.0  # screws; dark streaks
    changed = (bone != truth).sum() / truth.sum()
    assert 0.01 < changed < 0.15


def test_plates_lie_over_the_cut_with_one_end_on_either_bone(head):
    sites = plate_sites(head, CRANIUM, segment_code(0), 4, np.random.default_rng(0))
    assert 2 <= len(sites) <= 4
    for ends in sites:
        for end, code in zip(ends, (CRANIUM, segment_code(0)), strict=True):
            assert head.labels[tuple(np.round((end - head.origin) / head.spacing).astype(int))] == code
        assert np.linalg.norm(np.subtract(*ends)) < 25
    assert plate_sites(head, segment_code(0), 200, 4, np.random.default_rng(0)) == []
