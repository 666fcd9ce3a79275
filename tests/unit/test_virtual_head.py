"""The label volume of virtual heads: complete, connected, skin outside, lips apart, deformities visible."""

import numpy as np
import pytest
from scipy import ndimage

from pinnochio.anatomy.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL, segment_code
from pinnochio.virtual.head import SEGMENTS, build_head
from pinnochio.virtual.parameters import DEFORMITIES, sample_parameters

CODES = [SUPERFICIAL, MUSCLE, CRANIUM, *(segment_code(i) for i in range(len(SEGMENTS)))]
TISSUE = (SUPERFICIAL, MUSCLE)


@pytest.fixture(scope="module")
def heads():
    return {d: build_head(sample_parameters(np.random.default_rng(7 + i), d)) for i, d in enumerate(DEFORMITIES)}


@pytest.fixture(scope="module", params=DEFORMITIES)
def head(request, heads):
    return heads[request.param]


def index(head, point):
    return np.round((point - head.origin) / head.spacing).astype(int)


def test_every_label_is_one_component(head):
    for code in CODES:
        own = head.labels == code
        assert own.sum() > 4000, code
        assert ndimage.label(own)[1] == 1, code
    assert set(np.unique(head.labels)) == {AIR, *CODES}
    assert ndimage.label(np.isin(head.labels, TISSUE))[1] == 1
    assert ndimage.label(head.labels == AIR)[1] == 1


def test_tissue_amounts_are_those_of_a_face(head):
    cm3 = head.spacing.prod() / 1000
    assert 400 < (head.labels == SUPERFICIAL).sum() * cm3 < 900
    assert 90 < (head.labels == MUSCLE).sum() * cm3 < 220


def test_the_cut_is_the_box(head):
    """Air in front and at both sides; the head reaches the top, bottom and back faces."""
    labels = head.labels
    assert (labels[[0, -1]] == AIR).all() and (labels[:, 0] == AIR).all()
    assert (labels[:, -1] > 0).any() and (labels[:, :, 0] > 0).any() and (labels[:, :, -1] > 0).any()


def test_skin_is_superficial_and_three_voxels_thick(head):
    """From the front and from both sides the first tissue is superficial; muscle lies at least 3 voxels deep."""
    solid = head.labels != AIR
    for axis, reverse in ((1, False), (0, False), (0, True)):
        view = np.flip(head.labels, axis) if reverse else head.labels
        hit = np.flip(solid, axis) if reverse else solid
        first = np.take_along_axis(view, hit.argmax(axis)[(slice(None),) * axis + (None,)], axis).squeeze(axis)
        seen = first[hit.any(axis)]
        if axis == 1:  # from the front the slit shows teeth and the flanks of the throat may be seen through it
            assert (seen == SUPERFICIAL).mean() > 0.995
        else:
            assert (seen == SUPERFICIAL).all()
    outside = ndimage.binary_dilation(head.labels[:, :60] == AIR, iterations=2)
    front = ndimage.label(head.labels[:, :60] == AIR)[0]
    outside = ndimage.binary_dilation(front == front[0, 0, 0], iterations=1)
    assert not (outside & (head.labels[:, :60] == MUSCLE)).any()


def test_lips_are_apart(head):
    """On a slab about the midline no path of tissue joins upper and lower lip; without the slit one would."""
    mouth = index(head, 0.5 * (head.landmarks["labrale_superius"] + head.landmarks["labrale_inferius"]))
    teeth = index(head, np.maximum(head.landmarks["upper_incisor"], head.landmarks["lower_incisor"]))[1]
    slab = np.isin(head.labels[mouth[0] - 6 : mouth[0] + 7, : teeth + 2, mouth[2] - 22 : mouth[2] + 23], TISSUE)
    parts, _ = ndimage.label(slab, np.ones((3, 3, 3)))
    upper, lower = parts[:, :, 30:][slab[:, :, 30:]], parts[:, :, :14][slab[:, :, :14]]
    assert len(upper) > 200 and len(lower) > 200
    assert not set(np.unique(upper)) & set(np.unique(lower))


def test_lips_meet_at_the_corners(head):
    """Tissue goes round the mouth, so that both lips belong to one body."""
    for side in ("left", "right"):
        corner = index(head, head.landmarks[f"cheilion_{side}"])
        column = head.labels[corner[0], corner[1] + 3 : corner[1] + 6, corner[2] - 2 : corner[2] + 3]
        assert np.isin(column, TISSUE).all()


def test_landmarks_are_in_order(head):
    mark = head.landmarks
    heights = [
        "nasion",
        "pronasale",
        "subnasale",
        "labrale_superius",
        "labrale_inferius",
        "pogonion_soft",
        "menton_soft",
    ]
    assert (np.diff([mark[name][2] for name in heights]) < 0).all()
    assert mark["pronasale"][1] == min(mark[name][1] for name in heights)
    assert mark["tragus_left"][0] > mark["cheilion_left"][0] > 0 > mark["cheilion_right"][0] > mark["tragus_right"][0]
    assert np.allclose(mark["condyle_left"] * [-1, 1, 1], mark["condyle_right"])
    for name in heights[:-1]:  # on the skin: air before it, tissue behind it
        point = mark[name]
        assert head.labels[tuple(index(head, point - [0, 1, 0]))] == AIR
        assert head.labels[tuple(index(head, point + [0, 1, 0]))] == SUPERFICIAL
    for name, code in (("condyle_left", 13), ("condyle_right", 14), ("pogonion_bone", 12)):
        assert head.labels[tuple(index(head, mark[name] + ([0, 2, 0] if code == 12 else 0)))] == code


def thickness(head, point, along):
    """Distance (mm) from skin to bone along a grid axis through the point, from the low end of the axis."""
    at = index(head, point)
    where = [slice(None) if axis == along else at[axis] for axis in range(3)]
    line = head.labels[tuple(where)]
    return (np.flatnonzero(line >= CRANIUM)[0] - np.flatnonzero(line)[0]) * head.spacing[along]


def test_thickness_is_that_of_the_parameters(head):
    """Skin over bone where it was asked for: firm places within 2.6 mm, the lips within 4.5 mm."""
    p, mark = head.parameters, head.landmarks
    assert thickness(head, mark["nasion"], 1) == pytest.approx(p.nasion, abs=2.6)
    assert thickness(head, mark["pogonion_bone"], 1) == pytest.approx(p.pogonion, abs=2.6)
    assert thickness(head, mark["labrale_superius"], 1) == pytest.approx(p.labrale_superius, abs=4.5)
    if p.open_bite < 1:  # an open bite leaves no bone behind the lower lip
        assert thickness(head, mark["labrale_inferius"], 1) == pytest.approx(p.labrale_inferius, abs=4.5)


def test_menton_thickness(head):
    """Below the chin, over the lower border of the mandible, on a line clear of the neck."""
    below = head.landmarks["pogonion_bone"] + [0, 6, 0]
    line = head.labels[index(head, below)[0], index(head, below)[1], :]
    bone = np.flatnonzero(line >= CRANIUM)[0]
    assert (bone - np.flatnonzero(line[:bone])[0]) * head.spacing[2] == pytest.approx(head.parameters.menton, abs=2.6)


def test_bite_shows_in_the_bones(heads):
    """The overjet of the label volume, from the most forward voxel of each tooth row, has the sign of its class."""

    def overjet(head):
        front = {}
        for code, name in ((11, "upper_incisor"), (12, "lower_incisor")):
            i, _, k = index(head, head.landmarks[name])
            rows = (
                head.labels[i - 3 : i + 4, :, k + 1 : k + 5]
                if code == 11
                else head.labels[i - 3 : i + 4, :, k - 5 : k - 1]
            )
            front[code] = np.argwhere(rows == code)[:, 1].min()
        return float(front[12] - front[11])

    for head in heads.values():
        assert overjet(head) == pytest.approx(head.parameters.overjet, abs=1.6)
    assert overjet(heads["class_ii"]) > 3 and overjet(heads["class_iii"]) < -1


def asymmetry(head):
    """Share of lower-face voxels whose mirror image is of the other kind, air or not."""
    lower = head.labels[:, :, : index(head, head.landmarks["subnasale"])[2]] > 0
    return (lower != lower[::-1]).mean()


def test_asymmetric_patients_are_asymmetric(heads):
    others = [asymmetry(head) for name, head in heads.items() if name != "asymmetry"]
    assert asymmetry(heads["asymmetry"]) > 1.3 * max(others) and min(others) > 0


def test_same_parameters_same_bytes_and_other_spacing_same_head(heads):
    head = heads["open_bite"]
    again = build_head(head.parameters)
    assert np.array_equal(head.labels, again.labels)
    coarse = build_head(head.parameters, spacing=2.0)
    for code in CODES:
        ratio = (coarse.labels == code).sum() * 8 / (head.labels == code).sum()
        assert 0.85 < ratio < 1.15, code


def test_chin_as_fifth_segment(heads):
    head = build_head(heads["class_ii"].parameters, spacing=1.5, genioplasty=True)
    assert head.segments[-1] == "chin"
    assert ndimage.label(head.labels == segment_code(4))[1] == 1
