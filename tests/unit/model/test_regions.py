"""Landmarks and regions of the face on virtual heads, whose landmarks are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.triangles import vertex_areas
from pinnochio.model import patient as m
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import CHEEK_LEFT, CHEEK_RIGHT, NAMES, NECK, NOT_JUDGED, OTHER, divide, jaw_plane, regions
from pinnochio.virtual.head import SEGMENTS
from pinnochio.virtual.procedures import DEFORMITIES
from tests.helpers.virtual_heads import face_alone, virtual_head

# What each landmark of the virtual head must lie in.
WITHIN = {
    "pronasale": {"nose"},
    "labrale_superius": {"upper_lip"},
    "labrale_inferius": {"lower_lip"},
    "mentolabial": {"lower_lip", "chin"},
    "pogonion_soft": {"chin"},
}


@pytest.fixture(scope="module")
def heads():
    """Head, model and regions of a patient of each deformity."""
    by_deformity = {}
    for deformity in DEFORMITIES:
        model = face_alone(deformity)
        by_deformity[deformity] = virtual_head(deformity), model, regions(model)
    return by_deformity


@pytest.fixture(params=DEFORMITIES)
def head(request, heads):
    return heads[request.param]


def mapped(model: PatientModel, scale=(1, 1, 1), shift=(0, 0, 0)) -> PatientModel:
    """The patient with every place scaled and shifted, its surfaces still outward."""
    flipped = np.prod(scale) < 0

    def place(points):
        return points * np.array(scale) + np.array(shift)

    def turned(faces):
        return faces[:, ::-1] if flipped else faces

    return replace(
        model,
        points=place(model.points),
        skin_points=place(model.skin_points),
        skin_faces=turned(model.skin_faces),
        bone_points=place(model.bone_points),
        bone_faces=turned(model.bone_faces),
    )


def test_every_judged_point_has_a_region_and_no_other(head):
    _, model, codes = head
    judged = np.zeros(len(codes), bool)
    judged[model.skin_faces[model.face_roi]] = True
    assert codes.dtype == np.int8 and ((codes == NOT_JUDGED) == ~judged).all()
    assert (np.bincount(codes[judged], minlength=len(NAMES)) > 100).all()


def test_landmarks_lie_where_the_head_was_built_with_them(head):
    truth, derived = head[0].landmarks, face_landmarks(head[1])
    heights = {
        "pronasale": ("pronasale", 3),
        "labrale_superius": ("labrale_superius", 4),
        "labrale_inferius": ("labrale_inferius", 5),
        "sublabiale": ("mentolabial", 8),
    }
    heights |= {"subnasale": ("subnasale", 8), "sellion": ("nasion", 12)}
    for ours, (name, tolerance) in heights.items():
        assert abs(getattr(derived, ours)[2] - truth[name][2]) < tolerance, ours
    between = 0.5 * (truth["upper_incisor"] + truth["lower_incisor"])
    assert abs(derived.stomion[2] - between[2]) < 5
    assert abs(derived.pogonion[0] - truth["pogonion_soft"][0]) < 3
    for row, side in enumerate(("right", "left")):
        assert abs(derived.cheilion[row, 0] - truth[f"cheilion_{side}"][0]) < 7
        assert 12 <= abs(derived.alare[row, 0]) <= 24


def test_landmarks_lie_in_their_regions(head):
    built, model, codes = head
    judged = np.flatnonzero(codes != NOT_JUDGED)
    tree = cKDTree(model.skin_points[judged])
    for name, allowed in WITHIN.items():
        near = codes[judged[tree.query(built.landmarks[name], 3)[1]]]
        assert {NAMES[code] for code in near} <= allowed, name


def test_a_surgeon_finds_each_region_in_one_piece(head):
    _, model, codes = head
    edges = model.skin_faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    for code in range(OTHER):
        inside = edges[(codes[edges] == code).all(axis=1)]
        graph = sparse.coo_array((np.ones(len(inside)), inside.T), (len(codes),) * 2)
        piece = connected_components(graph, directed=False)[1][codes == code]
        assert np.bincount(piece).max() > 0.95 * len(piece), NAMES[code]


def test_regions_follow_one_another_from_top_to_bottom(head):
    _, model, codes = head
    height = [model.skin_points[codes == code, 2].mean() for code in range(4)]
    assert (np.diff(height) < 0).all()
    assert model.skin_points[codes == CHEEK_RIGHT, 0].max() < 5 and model.skin_points[codes == CHEEK_LEFT, 0].min() > -5


def test_neck_and_forehead_are_no_cheeks(head):
    """Below the jaw's border by more than tissue is thick there, and above the orbits' rims."""
    _, model, codes = head
    cheeks = model.skin_points[(codes == CHEEK_LEFT) | (codes == CHEEK_RIGHT), 2]
    jaw = model.bone_points[model.bone_segment == SEGMENTS.index("mandible_distal"), 2]
    assert cheeks.min() > jaw.min() - 12
    assert cheeks.max() < face_landmarks(model).sellion[2]


def test_the_neck_begins_below_the_border_of_the_jaw(head):
    """By the lower end of the jaw's bone, seen from the side: the skin of the neck is below, all skin below is neck."""
    _, model, codes = head
    menton, down = jaw_plane(model, face_landmarks(model))
    assert down[0] == 0 and 10 < np.degrees(np.arctan2(down[1], -down[2])) < 40
    depth = (model.skin_points - menton) @ down
    assert (codes[depth <= 0] != NECK).all() and (codes[(depth > 0) & (codes != NOT_JUDGED)] == NECK).all()
    # No bone of the lower jaw reaches below it, and its border is as far above as tissue is thick.
    jaw = np.isin(model.bone_segment, [SEGMENTS.index(name) for name in SEGMENTS if name != "lefort1"])
    bone = (model.bone_points[jaw] - menton) @ down
    assert -14 < bone.max() < 0
    face = vertex_areas(model.skin_points, model.skin_faces[model.face_roi])
    assert 0.1 < face[codes == NECK].sum() / face.sum() < 0.3
    # In front the plane passes through the skin below the chin: all of the chin is above it.
    assert (depth[codes == NAMES.index("chin")] <= 0).all() and abs(
        menton[0] - head[0].landmarks["pogonion_soft"][0]
    ) < 5


def test_a_jaw_tilted_to_one_side_gets_a_level_plane(heads):
    _, model, _ = heads["class_ii"]
    tilted = replace(
        model,
        bone_points=model.bone_points + np.c_[np.zeros((len(model.bone_points), 2)), 0.05 * model.bone_points[:, 0]],
    )
    (_, before), (_, after) = (jaw_plane(patient, face_landmarks(patient)) for patient in (model, tilted))
    assert after[0] == 0 and np.degrees(np.arccos(before @ after)) < 3


def test_a_mirrored_face_has_mirrored_regions(heads):
    _, model, codes = heads["asymmetry"]
    swapped = np.array([0, 1, 2, 3, CHEEK_LEFT, CHEEK_RIGHT, OTHER, NECK, NOT_JUDGED], np.int8)[codes]
    assert (regions(mapped(model, (-1, 1, 1))) == swapped).mean() > 0.995


def test_a_moved_face_keeps_its_regions(heads):
    _, model, codes = heads["class_iii"]
    assert (regions(mapped(model, shift=(40, -300, 25))) == codes).mean() > 0.995


def test_lip_nodes_tell_the_lips_apart_near_the_slit_only(heads):
    _, model, codes = heads["class_ii"]
    mouth = face_landmarks(model).stomion[2]
    depth = model.skin_points[:, 2] - mouth
    lower = codes == NAMES.index("lower_lip")
    lip = np.zeros(len(model.points), np.int8)
    lip[lower] = m.UPPER_LIP  # as if all of it hung from the upper lip
    corrected = regions(replace(model, lip=lip))
    near = face_landmarks(replace(model, lip=lip)).stomion[2]
    assert near == mouth  # both lips are needed for a slit
    assert (corrected[lower & (depth > -4.5)] == NAMES.index("upper_lip")).all() and (lower & (depth > -4.5)).any()
    assert (corrected[lower & (depth < -5.5)] == NAMES.index("lower_lip")).mean() > 0.99


def test_each_side_has_a_corner_of_the_mouth(heads):
    _, model, codes = heads["class_iii"]
    judged = codes != NOT_JUDGED
    points, lip = model.skin_points[judged], np.full(judged.sum(), m.NOT_LIP)
    marks = face_landmarks(model)
    wide = marks.cheilion + [[0, 0, 0], [10, 0, 0]]
    changed = divide(points, lip, replace(marks, cheilion=wide), model.bone_points, model.bone_faces)
    before = divide(points, lip, marks, model.bone_points, model.bone_faces)
    assert (changed != before).sum() > 50
    assert (before[changed != before] == CHEEK_LEFT).all() and (points[changed != before, 0] > 15).all()


def test_a_jaw_of_any_name_will_do(heads):
    """Without a segment named after the upper jaw all segments count; the chin is known by its place."""
    _, model, codes = heads["open_bite"]
    bone = np.where(model.bone_segment == 0, 0, -1).astype(np.int8)
    renamed = replace(model, segments=("piece",), bone_segment=bone)
    assert (regions(renamed) == codes).mean() > 0.995


@pytest.mark.parametrize("lacking", ["skin", "bone", "chin"])
def test_what_is_no_face_is_refused(heads, lacking):
    _, model, _ = heads["class_ii"]
    if lacking == "skin":
        model = replace(model, skin_faces=model.skin_faces[:0], face_roi=model.face_roi[:0])
    elif lacking == "bone":
        model = replace(model, bone_segment=np.full_like(model.bone_segment, -1), segments=())
    else:
        model = replace(model, bone_points=np.maximum(model.bone_points, [-np.inf, -np.inf, -40]))
    with pytest.raises(InputError, match="cannot be read"):
        regions(model)
