"""Stray voxels, fragments and holes: what is repaired, what is kept, what is refused."""

import numpy as np
import pytest
from scipy import ndimage

from pinnochio.errors import InputError
from pinnochio.importing.repair import KEPT, LARGEST_HOLE, repair, repaired_voxels
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL, TOUCHING, segment_code
from tests.helpers.virtual_heads import virtual_head

SEGMENTS = ("lefort1", "mandible")
UPPER, LOWER = segment_code(0), segment_code(1)


def head():
    """A block of soft tissue, cut at the back, with two jaws, two pieces of cranium, two muscles and a mouth."""
    labels = np.zeros((60, 50, 60), np.uint8)
    labels[5:55, 5:, 5:55] = SUPERFICIAL
    labels[8:14, 15:40, 10:50], labels[46:52, 15:40, 10:50] = MUSCLE, MUSCLE
    labels[15:25, 20:45, 46:52], labels[35:45, 20:45, 46:52] = CRANIUM, CRANIUM
    labels[18:42, 15:45, 33:42] = UPPER
    labels[18:42, 15:45, 10:20] = LOWER
    labels[22:38, 20:45, 22:30] = AIR
    return labels


def mend(labels, limit=2.0, **more):
    return repair(labels, SEGMENTS, limit, "P1", "head.nii.gz", **more)


def said(statements):
    return {(s["structure"], s["what"]): s["voxels"] for s in statements}


def test_a_clean_map_keeps_its_bytes_and_its_mouth_is_stated():
    labels = head()
    mended, statements = mend(labels)
    assert mended.dtype == labels.dtype and mended.tobytes() == labels.tobytes()
    assert said(statements) == {("air", KEPT): 16 * 25 * 8} and repaired_voxels(statements) == 0
    _, statements = mend(np.pad(labels, 2))
    assert [s["voxels"] for s in statements] == [16 * 25 * 8], "nor is the head itself taken for a cavity"


def test_salt_and_pepper_goes_and_the_rest_stays():
    clean, rng = head(), np.random.default_rng(3)
    noisy = clean.copy()
    # 1 % of the voxels inside each structure, each anything else.
    for code in (SUPERFICIAL, MUSCLE, CRANIUM, UPPER, LOWER):
        inside = np.argwhere(ndimage.binary_erosion(clean == code, TOUCHING))
        chosen = tuple(rng.choice(inside, len(inside) // 100, replace=False).T)
        others = [other for other in (AIR, SUPERFICIAL, MUSCLE, CRANIUM, UPPER, LOWER) if other != code]
        noisy[chosen] = rng.choice(others, len(chosen[0]))
    wrong = int((noisy != clean).sum())
    assert wrong > 500
    before = noisy.copy()
    mended, statements = mend(noisy, limit=5.0)
    assert np.array_equal(noisy, before), "the argument is left alone"
    assert (mended == clean).all()
    assert repaired_voxels(statements) == wrong
    assert (mend(noisy, limit=5.0)[0] == mended).all()


def test_a_fragment_of_a_segment_joins_what_surrounds_it():
    labels = head()
    labels[9:12, 18:22, 12:16] = LOWER  # 48 voxels in the right muscle
    labels[30:33, 1:4, 1:4] = LOWER  # 27 in the air
    mended, statements = mend(labels)
    assert (mended == head()).all()
    assert {k: v for k, v in said(statements).items() if k[1] != KEPT} == {
        ("mandible", "fragment to muscle"): 48,
        ("mandible", "fragment to air"): 27,
    }


def test_loose_soft_tissue_goes_whatever_its_labels():
    labels = head()
    labels[30:34, 0:2, 0:4], labels[30:34, 2:3, 0:4] = SUPERFICIAL, MUSCLE
    mended, statements = mend(labels)
    assert (mended == head()).all()
    assert sum(v for k, v in said(statements).items() if k[1] != KEPT) == 48


@pytest.mark.parametrize(("spacing", "filled"), [(1.0, True), (2.0, False)])
def test_a_hole_is_filled_by_its_size_in_mm(spacing, filled):
    labels = head()
    labels[22:28, 20:26, 12:18] = AIR  # 216 voxels
    assert 216 < LARGEST_HOLE < 216 * 8
    mended, statements = mend(labels, limit=20.0, voxel=spacing**3)
    assert (mended == head()).all() == filled
    assert said(statements).get(("air", "hole to mandible"), 0) == 216 * filled
    assert sorted(s["voxels"] for s in statements if s["what"] == KEPT) == [216] * (not filled) + [3200]


def test_air_that_reaches_the_border_or_the_outside_is_no_hole():
    labels = head()
    labels[22:25, 44:, 25:28] = AIR  # an airway from the mouth to the cut at the back
    labels[30, 5:20, 26] = AIR  # a slit from the mouth to the front
    mended, statements = mend(labels)
    assert (mended == labels).all() and not statements


@pytest.mark.parametrize(("limit", "passes"), [(1.0, False), (2.0, True)])
def test_the_limit_is_a_share_of_the_structure(limit, passes):
    labels = head()
    size = (labels == LOWER).sum()
    labels[9:12, 18:24, 12:18] = LOWER
    assert 0.01 < 108 / (size + 108) < 0.02
    if passes:
        mend(labels, limit)
    else:
        with pytest.raises(InputError, match=r"'P1': head.nii.gz.* 1.48 % of 'mandible' \(108 of 7308 .*limit is 1 %"):
            mend(labels, limit)


def test_what_a_structure_gains_counts_too():
    labels = head()
    labels[22:29, 20:27, 12:19] = AIR
    with pytest.raises(InputError, match=r"343 of 6857 voxels"):
        mend(labels, 4.0)
    assert (mend(labels, 6.0)[0] == head()).all()


def test_a_virtual_head_is_clean():
    made = virtual_head("class_iii", 1.5)
    mended, statements = repair(made.labels, made.segments, 0.0, "V", "v.nii.gz", 1.5**3)
    assert mended.tobytes() == made.labels.tobytes() and repaired_voxels(statements) == 0
