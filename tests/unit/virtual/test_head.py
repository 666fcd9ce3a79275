"""The label volume of virtual heads: complete, connected, skin outside, lips apart, deformities visible."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv
from scipy import ndimage

from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL, segment_code
from pinnochio.model.surfaces import bone_surface, skin_surface
from pinnochio.virtual.carry import anatomy
from pinnochio.virtual.head import SEGMENTS, USUAL, build_head, face_grid
from pinnochio.virtual.implicit import Field
from pinnochio.virtual.muscles import muscle_shapes
from pinnochio.virtual.parameters import TABLE, distribution
from pinnochio.virtual.procedures import DEFORMITIES, MANDIBLE, MAXILLA, Procedure
from pinnochio.virtual.scanned import sample_patient
from pinnochio.virtual.skeleton import Skeleton
from tests.helpers.virtual_heads import virtual_head

CODES = [SUPERFICIAL, MUSCLE, CRANIUM, *(segment_code(i) for i in range(len(SEGMENTS)))]
TISSUE = (SUPERFICIAL, MUSCLE)


@pytest.fixture(scope="module")
def heads():
    return {deformity: virtual_head(deformity, 1.0, number=1) for deformity in DEFORMITIES}


@pytest.fixture(scope="module", params=DEFORMITIES)
def head(request, heads):
    return heads[request.param]


def index(head, point):
    return np.round((point - head.origin) / head.spacing).astype(int)


def test_tissue_amounts_are_those_of_a_face(head):
    cm3 = head.spacing.prod() / 1000
    assert 350 < (head.labels == SUPERFICIAL).sum() * cm3 < 900
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
            assert (seen != SUPERFICIAL).sum() <= 1
    front = ndimage.label(head.labels[:, :60] == AIR)[0]
    outside = ndimage.binary_dilation(front == front[0, 0, 0], iterations=1)
    assert (outside & (head.labels[:, :60] == MUSCLE)).sum() <= 100  # at the corners of a mouth that gapes


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
    coarse = virtual_head("open_bite", number=1)
    for code in CODES:
        ratio = (coarse.labels == code).sum() * 8 / (head.labels == code).sum()
        assert 0.85 < ratio < 1.15, code


@pytest.mark.parametrize(
    "procedure",
    [
        Procedure(chin=True),
        Procedure(MANDIBLE),
        Procedure(MAXILLA, chin=True),
        Procedure(MAXILLA, 2),
        Procedure(pieces=3),
    ],
    ids=lambda procedure: procedure.name,
)
def test_the_cuts_of_a_procedure_part_the_same_bone(heads, procedure):
    """Each segment is one piece; together they and the cranium fill what a head that is cut otherwise has of bone."""
    usual, head = (virtual_head("class_ii", 1.5, cuts, 1) for cuts in (USUAL, procedure))
    codes = [segment_code(i) for i in range(len(head.segments))]
    assert set(np.unique(head.labels)) == {AIR, SUPERFICIAL, MUSCLE, CRANIUM, *codes}
    for code in codes:
        assert ndimage.label(head.labels == code, np.ones((3, 3, 3)))[1] == 1, head.segments[code - codes[0]]
    assert (head.labels >= CRANIUM).sum() == pytest.approx((usual.labels >= CRANIUM).sum(), rel=0.001)

    def voxels(of_head, words):
        names = [i for i, name in enumerate(of_head.segments) if any(word in name for word in words)]
        return np.isin(of_head.labels, [segment_code(i) for i in names])

    for words in (("lefort",), ("mandible", "proximal", "chin")):
        if voxels(head, words).any():
            assert (voxels(head, words) != voxels(usual, words)).sum() < 0.01 * voxels(usual, words).sum()


def test_every_muscle_has_its_size_and_both_sides(heads):
    p = heads["class_ii"].parameters
    face = anatomy(p).face
    axes = face_grid(Skeleton(p), face, 2.0)
    for name, shapes in muscle_shapes(Skeleton(p), face.marks, face.line).items():
        muscle = Field(axes, reach=4.0).union(*shapes, k=3).values < 0
        assert 400 < muscle.sum() * 8 < 100_000, name
        left, right = muscle[muscle.shape[0] // 2 :].sum(), muscle[: muscle.shape[0] // 2].sum()
        assert 0.4 < left / right < 2.5, name


def faults(points, faces):
    """Open and non-manifold edges of a surface; points of the open ones."""
    mesh = pv.PolyData.from_regular_faces(points, faces)
    kinds = {"boundary_edges": False, "non_manifold_edges": False, "feature_edges": False, "manifold_edges": False}
    twice = mesh.extract_feature_edges(**kinds | {"non_manifold_edges": True}).n_cells
    rim = mesh.extract_feature_edges(**kinds | {"boundary_edges": True})
    return rim.n_cells, twice, rim.points


@pytest.mark.parametrize("deformity", DEFORMITIES)
def test_bones_are_closed_surfaces_and_skin_ends_at_the_cut(deformity):
    head = virtual_head(deformity, number=1)
    bone = bone_surface(head.labels, head.spacing, head.origin, head.segments, 5.0)
    for index in range(-1, len(head.segments)):
        part = bone.part(index)
        assert len(part.points) > 100 and faults(part.points, part.faces)[:2] == (0, 0), index
    rim, twice, places = faults(*skin_surface(head.labels, head.spacing, head.origin, None))
    assert rim > 0 and twice == 0
    high = head.origin + head.spacing * (np.array(head.labels.shape) - 1)
    assert np.minimum(np.abs(places - head.origin), np.abs(places - high)).min(1).max() < 3


def test_women_and_men_differ():
    """Mean woman and mean man: jaw, chin, brow and ramus larger in men."""
    woman, man = ({n: distribution(n, male, "class_ii")[0] for n in TABLE} for male in (False, True))
    for name in ("gonial_width", "chin_width", "brow_prominence", "ramus_height"):
        assert man[name] > woman[name] + 0.5 * TABLE[name].sd, name


def test_gonion_follows_length_height_and_angle():
    """Ramus and body keep near what was sampled, and a wider angle lays the gonion higher and the plane steeper."""
    for number in range(40):
        p = sample_patient(np.random.default_rng(number), DEFORMITIES[number % 4])
        s = Skeleton(p)
        ramus = np.linalg.norm((s.gonion - s.condyle - [0, 0, 5])[1:])
        body = np.linalg.norm((s.gonion - s.pogonion)[1:])
        assert abs(ramus - p.ramus_height) < 10 and abs(body - p.mandible_length) < 15
        assert 98 < s.gonial_angle < 145
    wide, narrow = (Skeleton(replace(p, gonial_angle=angle)) for angle in (138.0, 108.0))
    assert wide.gonial_angle > narrow.gonial_angle + 8 and wide.gonion[2] > narrow.gonion[2]
