"""Fixed places of the skeleton: the same ones however a head is cut, moved by whatever segment carries them."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.methods.pca_linear import features
from pinnochio.model.bones import PLACES, motion_of_places, nasion_height, places
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.surfaces import bone_surface
from pinnochio.plans.plan import Plan
from pinnochio.virtual.procedures import MANDIBLE, MAXILLA, Procedure
from tests.helpers.virtual_heads import face_alone, virtual_head

PROCEDURES = Procedure(), Procedure(MANDIBLE, chin=True), Procedure(MAXILLA), Procedure(pieces=3), Procedure(MAXILLA, 2)


@pytest.fixture(scope="module")
def models():
    """One person, cut in several ways; the skin is the same."""
    made = {}
    for procedure in PROCEDURES:
        head = virtual_head("class_iii", 2.0, procedure)
        bone = bone_surface(head.labels, head.spacing, head.origin, head.segments, 4.0)
        surface = {"bone_points": bone.points, "bone_normals": bone.normals, "bone_faces": bone.faces}
        whole = made.get(PROCEDURES[0]) or face_alone("class_iii")
        made[procedure] = replace(whole, **surface, bone_segment=bone.segment, segments=head.segments)
    return made


def middles(model):
    return {name: model.bone_points[nodes].mean(axis=0) for name, nodes in places(model).items() if len(nodes)}


def test_the_places_are_where_they_are_whatever_is_cut(models):
    usual = middles(models[PROCEDURES[0]])
    assert tuple(usual) == PLACES
    assert usual["upper_molars_left"][0] > 15 and usual["gonion_right"][0] < -30
    assert usual["chin"][2] < usual["lower_incisors"][2] - 15
    assert usual["upper_incisors"][1] < usual["gonion_left"][1] - 40
    for procedure, model in models.items():
        centres = middles(model)
        lacking = {name for name in PLACES if name.startswith("upper")} if procedure.jaws == MANDIBLE else set()
        assert set(centres) == set(PLACES) - lacking, procedure.name
        for name, place in centres.items():
            assert np.linalg.norm(place - usual[name]) < 6, (procedure.name, name)


def test_one_motion_of_all_bone_has_the_same_features_however_it_is_cut(models):
    """As far as the cuts go: what is not cut stays."""
    move = RigidMotion.from_degrees((2, 0, 0), (1, -4, 2), np.array([0.0, -60, -40]))
    said = {}
    for procedure, model in models.items():
        plan = Plan("P", dict.fromkeys(model.segments, move))
        said[procedure] = features(model, plan, np.zeros(3))
        assert len(said[procedure]) == 3 * len(PLACES) + 3
        for name, moved in motion_of_places(model, plan).items():
            still = procedure.jaws == MANDIBLE and name.startswith("upper")
            assert (not moved.any()) if still else np.linalg.norm(moved - [1, -4, 2]) < 2.5
    one, pieces = said[PROCEDURES[0]], said[PROCEDURES[3]]
    np.testing.assert_allclose(one, pieces, atol=0.3)


def test_landmarks_and_the_height_of_the_nasion_hold_without_a_cut_maxilla(models):
    usual, lower = (models[procedure] for procedure in PROCEDURES[:2])
    one, other = (vars(face_landmarks(model)) for model in (usual, lower))
    for name in one:
        assert np.abs(one[name] - other[name]).max() < 4, name
    heights = [nasion_height(model.bone_points, model.bone_segment, model.segments, 20.0) for model in (usual, lower)]
    assert abs(heights[0] - heights[1]) < 8
    assert nasion_height(usual.bone_points, usual.bone_segment * 0 - 1, (), 20.0) == np.inf
