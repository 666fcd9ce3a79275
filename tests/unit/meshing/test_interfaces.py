"""Interface labels on a block face whose every answer is known, on a virtual head and on an expert's node sets."""

import meshio
import numpy as np
import pytest
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.tetrahedralize import tetrahedralize
from pinnochio.model import patient as m
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL
from pinnochio.model.surfaces import bone_surface
from tests.helpers.heads import DISTAL, LEFORT, ORIGIN, PROXIMAL, SEGMENTS, block_face
from tests.helpers.settings import DATA
from tests.helpers.virtual_heads import virtual_head

ARTISYNTH = DATA / "artisynth_face"


@pytest.fixture(scope="module")
def face():
    labels, spacing, origin = block_face()
    mesh = tetrahedralize(labels, spacing, origin, 2500)
    return mesh, labels, bone_surface(labels, spacing, origin, SEGMENTS)


def labelled(face, **options):
    mesh, labels, bone = face
    return label_interfaces(mesh, labels, np.ones(3), ORIGIN, SEGMENTS, bone, **options)


def test_beyond_follows_the_bones(face):
    model = labelled(face)
    place = model.points - ORIGIN
    back = (np.abs(place[:, 1] - 21.5) < 0.6) & (place[:, 0] > 2) & (place[:, 0] < 53)
    for code, low, high in ((CRANIUM, 58, 76), (LEFORT, 41, 53), (DISTAL, 4, 29)):
        here = back & (place[:, 2] > low) & (place[:, 2] < high)
        here &= (place[:, 0] < 36) | (code != DISTAL)
        assert here.sum() > 10 and (model.node_beyond[here] == code).mean() > 0.97
    right = back & (place[:, 0] > 44) & (place[:, 2] > 4) & (place[:, 2] < 29)
    assert right.sum() > 5 and (model.node_beyond[right] == PROXIMAL).all()
    front = (np.abs(place[:, 1] - 7.5) < 0.6) & (place[:, 0] > 2) & (place[:, 0] < 53)
    front &= (place[:, 2] > 4) & (place[:, 2] < 76)
    assert front.sum() > 50 and (model.node_beyond[front] == AIR).all()
    boundary = np.zeros(len(place), bool)
    boundary[face[0].boundary_faces()[0]] = True
    assert np.array_equal(model.node_beyond == m.INTERIOR, ~boundary)


def test_types_follow_what_lies_beyond(face):
    model = labelled(face)
    place = model.points - ORIGIN
    cut = (np.isin(place[:, 0], (-0.5, 55.5)) | np.isin(place[:, 2], (-0.5, 79.5))) & (place[:, 1] < 22)
    assert (model.node_beyond[cut] == m.CUT_PLANE).all() and cut.sum() > 50
    seam = np.abs(place[:, 2] - 55.5) < 10
    below = (model.node_beyond == m.CUT_PLANE) & (place[:, 2] < 0)  # a cut mandible: what it carries follows
    fixed = ((model.node_beyond == m.CUT_PLANE) & ~below) | ((model.node_beyond == CRANIUM) & ~seam)
    assert np.array_equal((model.node_type == m.FIXED)[~seam | cut], fixed[~seam | cut])
    bound = np.isin(model.node_type, (m.MOVING, m.SLIDING))
    assert np.array_equal(model.node_segment >= 0, bound)
    assert np.array_equal(model.node_beyond[bound], 11 + model.node_segment[bound])
    assert (model.node_type[np.isin(model.node_beyond, (AIR, m.INTERIOR))] == m.FREE).all()


def test_tissue_is_lifted_off_at_osteotomies(face):
    """Between cranium and maxilla (z 55.5) and between the pieces of the mandible (x 39.5), but not at the mouth."""
    model = labelled(face, release=5.0)
    place = model.points - ORIGIN
    contact = np.isin(model.node_beyond, (CRANIUM, LEFORT, DISTAL, PROXIMAL))
    seam = np.minimum(np.abs(place[:, 2] - 55.5), np.where(place[:, 2] < 32, np.abs(place[:, 0] - 39.5), np.inf))
    free = model.node_type == m.FREE
    assert free[contact & (seam < 4)].all() and (contact & (seam < 4)).sum() > 30
    assert not free[contact & (seam > 9)].any()
    edges = model.cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    body = np.where(contact & ~free, model.node_beyond, 0)[edges]
    mixed = (body > 0).all(axis=1) & (body[:, 0] != body[:, 1])
    assert {tuple(sorted(pair)) for pair in body[mixed]} <= {(LEFORT, DISTAL)}


def test_tissue_that_the_field_of_view_cuts_off_a_chin_or_a_nose_follows():
    """Without the front of the face and the lower end of the mandible; beside and above the cut is held."""
    labels, spacing, origin = block_face()
    labels, origin = labels[:, 12:], origin + [0, 12, 0]
    bone = bone_surface(labels, spacing, origin, SEGMENTS, 4.0)
    mesh = tetrahedralize(labels, spacing, origin, 1500)
    model = label_interfaces(mesh, labels, spacing, origin, SEGMENTS, bone)
    place, cut = model.points - origin, model.node_beyond == m.CUT_PLANE
    front, below = cut & (place[:, 1] < -0.499), cut & (place[:, 2] < -0.499)
    assert front.sum() > 30 and below.sum() > 30
    assert (model.node_type[front | below] == m.FREE).all()
    above = cut & (place[:, 2] > 79.4) & ~front
    assert above.sum() > 20 and (model.node_type[above] == m.FIXED).all()
    labels = np.pad(labels, ((0, 0), (0, 0), (20, 0)))
    labels[:, :10, :20] = SUPERFICIAL  # the same with the chin whole: 20 mm of tissue below it, held where it ends
    bone = bone_surface(labels, spacing, origin - [0, 0, 20], SEGMENTS, 4.0)
    whole = label_interfaces(
        tetrahedralize(labels, spacing, origin - [0, 0, 20], 1500), labels, spacing, origin - [0, 0, 20], SEGMENTS, bone
    )
    end = (
        (whole.node_beyond == m.CUT_PLANE) & (whole.points[:, 2] < origin[2] - 20.4) & (whole.points[:, 1] > origin[1])
    )
    assert end.sum() > 20 and (whole.node_type[end] == m.FIXED).all()


def test_a_cut_lets_go_of_tissue_that_a_bone_carries():
    """Between a mandible and a cut one element below it no element belongs to both; elsewhere the cut is fixed."""
    labels = np.full((60, 70, 40), AIR, np.uint8)
    labels[:, 8:, :] = SUPERFICIAL
    labels[10:50, 16:36, 6:] = DISTAL
    mesh = tetrahedralize(labels, np.ones(3), ORIGIN, 900)
    bone = bone_surface(labels, np.ones(3), ORIGIN, SEGMENTS)
    model = label_interfaces(mesh, labels, np.ones(3), ORIGIN, SEGMENTS, bone)
    cut, constrained = model.node_beyond == m.CUT_PLANE, np.isin(model.node_type, (m.FIXED, m.MOVING))
    both = [(kind[model.cells]).any(axis=1) for kind in (model.node_type == m.FIXED, model.node_type == m.MOVING)]
    assert not (constrained[model.cells].all(axis=1) & np.all(both, axis=0)).any()
    place = model.points - ORIGIN
    under = cut & (place[:, 2] < 0) & (np.abs(place[:, 0] - 30) < 12) & (np.abs(place[:, 1] - 26) < 6)
    assert under.sum() > 5 and (model.node_type[under] == m.FREE).mean() > 0.5
    far = cut & (place[:, 1] > 50)
    assert far.sum() > 20 and (model.node_type[far] == m.FIXED).all()


@pytest.mark.parametrize("band", [11.0, 15.0])
def test_sliding_band_is_a_distance_to_the_opposing_jaw(face, band):
    model = labelled(face, sliding_band=band)
    z = model.points[:, 2] - ORIGIN[2]
    bound = np.isin(model.node_type, (m.MOVING, m.SLIDING)) & (model.points[:, 0] - ORIGIN[0] < 36)
    sliding = model.node_type == m.SLIDING
    upper, lower = (bound & (model.node_segment == i) for i in (0, 1))
    # The jaws end at 31.5 and 37.5.
    for jaw, gap in ((upper, z - 31.5), (lower, 37.5 - z)):
        inner, outer = jaw & (gap < band - 2), jaw & (gap > band + 1)
        assert inner.sum() > 3 and sliding[inner].all()
        assert not sliding[outer].any()
    assert not sliding[model.node_segment == 2].any()


def test_kinds(face):
    model = labelled(face)
    z = model.points[:, 2] - ORIGIN[2]
    contact = np.isin(model.node_beyond, (CRANIUM, LEFORT, DISTAL, PROXIMAL))
    bony = np.isin(model.interface_kind, (m.BONE_MUSCLE, m.BONE_SUPERFICIAL))
    assert np.array_equal(contact, bony)
    assert (model.interface_kind[contact & (z > 44)] == m.BONE_MUSCLE).all()
    assert (model.interface_kind[contact & (z < 32)] == m.BONE_SUPERFICIAL).all()
    meets = model.interface_kind == m.MUSCLE_SUPERFICIAL
    touch = [np.isin(np.arange(len(z)), model.cells[model.tissue == code]) for code in (MUSCLE, SUPERFICIAL)]
    assert np.array_equal(meets, touch[0] & touch[1] & ~contact)


def test_normals_are_unit_and_outward(face):
    model = labelled(face)
    length = np.linalg.norm(model.node_normal, axis=1)
    boundary = model.node_beyond != m.INTERIOR
    assert np.allclose(length[boundary], 1) and (length[~boundary] == 0).all()
    contact = (model.node_segment >= 0) & (np.abs(model.points[:, 2] - ORIGIN[2] - 34) > 8)
    assert np.median(model.node_normal[contact, 1]) > 0.99
    assert model.node_normal[contact, 1].min() > 0.5


def test_skin_is_the_front_and_not_the_mouth(face):
    model = labelled(face)
    corners = model.points[model.skin_faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert -cross[:, 1].sum() == pytest.approx(56 * 80, rel=0.03)
    assert (corners[..., 1].mean(axis=1) - ORIGIN[1]).max() < 7.5 + 4


def test_judged_face_keeps_off_nasion_and_cuts(face):
    model = labelled(face, nasion_above_maxilla=6.0, cut_margin=8.0)
    centre = model.points[model.skin_faces].mean(axis=1) - ORIGIN
    judged = centre[model.face_roi]
    assert judged[:, 2].max() < 55.5 + 6 + 1.0 and judged[:, 2].max() > 55
    assert judged[:, 0].min() > 7 and judged[:, 0].max() < 48 and judged[:, 2].min() > 7
    assert not labelled(face, tragus_before_mandible=40.0).face_roi.any()


def test_bone_of_unknown_segments_is_refused(face):
    mesh, labels, bone = face
    with pytest.raises(InputError, match="segments"):
        label_interfaces(mesh, labels, np.ones(3), ORIGIN, ("lefort1",), bone)


def test_virtual_head_has_every_kind_of_node():
    head = virtual_head("class_ii", 1.5)
    mesh = tetrahedralize(head.labels, head.spacing, head.origin, 3000)
    bone = bone_surface(head.labels, head.spacing, head.origin, head.segments)
    model = label_interfaces(mesh, head.labels, head.spacing, head.origin, head.segments, bone)
    assert set(model.node_type) == {m.FREE, m.FIXED, m.MOVING, m.SLIDING}
    assert set(model.interface_kind) == {0, m.BONE_MUSCLE, m.BONE_SUPERFICIAL, m.MUSCLE_SUPERFICIAL}
    assert set(model.node_segment[model.node_type == m.SLIDING]) == {0, 1}
    assert set(model.node_segment[model.node_type == m.MOVING]) == {0, 1, 2, 3}
    # Bone under the skin never holds the skin itself; the lining of the open nose lies on bone.
    skin = np.unique(model.skin_faces)
    nose = (np.abs(model.points[:, 0]) < 18) & (model.points[:, 2] > head.landmarks["labrale_superius"][2])
    inner = skin[np.isin(model.node_beyond[skin], (AIR, m.CUT_PLANE), invert=True) & ~nose[skin]]
    assert len(inner) <= 0.02 * len(skin)
    for name in ("pronasale", "pogonion_soft", "labrale_superius"):
        centres = model.points[model.skin_faces].mean(axis=1)
        distance, nearest = cKDTree(centres).query(head.landmarks[name])
        assert distance < 6 and model.face_roi[nearest]


@pytest.mark.full
def test_agreement_with_an_expert():
    """Node sets of the ArtiSynth face: jaw attachments move, lips and cheeks slide over the teeth."""
    if not ARTISYNTH.exists():
        pytest.skip(f"the ArtiSynth face is not at {ARTISYNTH}")
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.ReadImage(str(ARTISYNTH / "labels_1mm.nii.gz"))
    stored = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    low = np.array(image.GetOrigin())
    # Its face looks along -x: turn it by a right angle, so that it looks along -y with its left along +x.
    labels = np.ascontiguousarray(stored.transpose(1, 0, 2)[::-1])
    origin = np.array([-(low[1] + stored.shape[1] - 1), low[0], low[2]])
    segments = ("maxilla", "mandible")
    mesh = tetrahedralize(labels, np.ones(3), origin, 5000)
    model = label_interfaces(
        mesh, labels, np.ones(3), origin, segments, bone_surface(labels, np.ones(3), origin, segments)
    )
    expert = meshio.read(ARTISYNTH / "badinface_oop_csa_midsagittal_hex.vtu")
    places = expert.points[:, [1, 0, 2]] * [-1, 1, 1]
    contact = np.flatnonzero(model.node_segment >= 0)
    tree = cKDTree(model.points[contact])

    def share(name, kind):
        distance, nearest = tree.query(places[expert.point_data[name] > 0])
        return (model.node_type[contact[nearest[distance < 4]]] == kind).mean()

    assert share("jaw", m.MOVING) > 0.8
    assert share("mand_lig", m.MOVING) == 1
    assert share("lip_free", m.SLIDING) > 0.7
    assert share("cheek_free", m.SLIDING) > 0.6
