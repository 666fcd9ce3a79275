"""The cephalogram: what is read off the bone, and that its drawing goes with plan and field."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinnochio.figures.cephalogram import BEFORE, PLANNED, PREDICTED, SKIN_MARKS
from pinnochio.model.bone_landmarks import BONE_MEASURES, bone_landmarks, bone_measures
from pinnochio.model.measures import LANDMARKS
from pinnochio.patients.face_measures import FaceMeasures, in_numbers
from pinnochio.plans.plan import Plan, RigidMotion
from tests.helpers.virtual_heads import face_alone

REST = Plan("V", {})
FORWARD = Plan("V", {"lefort1": RigidMotion(translation=np.array([0.0, -4, 0]))})


@pytest.fixture(scope="module", params=["class_ii", "class_iii"])
def face(request):
    return FaceMeasures(face_alone(request.param))


def test_measures_of_bone_are_those_of_a_drawn_film():
    """N above the origin; A 2 mm and Pog 6 mm behind its vertical, 60 and 100 mm below."""
    places = {"N": (0, 0, 0), "A": (0, 2, -60), "B": (0, 5, -90), "Pog": (0, 6, -100), "Me": (0, 16, -110),
              "Go": (9, 76, -75), "U1": (0, -4, -80), "L1": (0, -1, -78)}  # fmt: skip
    values = dict(
        zip(BONE_MEASURES, bone_measures({name: np.array(at, float) for name, at in places.items()}), strict=True)
    )
    assert values["bone_anb"] == pytest.approx(np.degrees(np.arctan(5 / 90) - np.arctan(2 / 60)))
    assert values["bone_convexity"] == pytest.approx(np.degrees(np.arctan(4 / 40) - np.arctan(2 / 60)))
    assert [values[f"bone_{name}"] for name in ("a", "b", "pog", "overjet", "overbite")] == [-2, -5, -6, 3, 2]
    assert values["bone_mandibular_plane"] == pytest.approx(np.degrees(np.arctan(35 / 60)))
    assert np.isnan(bone_measures({"N": np.zeros(3)})).all()


def test_landmarks_of_bone_lie_where_anatomy_has_them_and_go_with_their_segment(face):
    rest = face._cephalogram.bone.under(REST)
    assert rest.keys() == {"N", "ANS", "A", "U1", "L1", "B", "Pog", "Me", "Go"}
    heights = [rest[name][2] for name in ("N", "ANS", "A", "U1", "B", "Pog", "Me")]
    assert heights == sorted(heights, reverse=True) and rest["Go"][1] > rest["Me"][1] + 40
    skin = face.landmarks.positions
    assert all(place[1] > np.nanmin(skin[:, 1]) for place in rest.values())  # none in front of the nose
    moved = face._cephalogram.bone.under(FORWARD)
    for name, place in rest.items():
        expected = [0, -4, 0] if name in ("ANS", "A", "U1") else [0, 0, 0]
        np.testing.assert_allclose(moved[name] - place, expected, atol=1e-9)
    rows = {row.name: row for row in face.bone_rows(FORWARD)}
    assert rows["bone_overjet"].change == pytest.approx(4) and rows["bone_pog"].change == 0
    assert [row["title"] for row in in_numbers(list(rows.values()))[2]][5] == "Overjet, mm"


def test_overjet_tells_class_ii_from_class_iii():
    two, three = (FaceMeasures(face_alone(kind)).bone_rows(REST) for kind in ("class_ii", "class_iii"))
    overjet = [next(row.before for row in rows if row.name == "bone_overjet") for rows in (two, three)]
    assert overjet[0] > 2 > 0 > overjet[1]


def test_bone_that_the_scan_does_not_show_is_left_out(face):
    patient = face._patient
    high = float(patient.bone_points[:, 2].max()) + 100
    assert "N" not in bone_landmarks(patient, 0.0, np.array([0, -80.0, high])).points


def test_a_root_without_a_hollow_has_no_nasion(face):
    patient, rest = face._patient, face._cephalogram.bone.under(REST)
    sellion, (x, y, z) = face.landmarks.positions[0], patient.bone_points.T
    flat = np.where((patient.bone_segment < 0) & (z > rest["N"][2] - 30), np.maximum(y, rest["N"][1]), y)
    plain = replace(patient, bone_points=np.column_stack([x, flat, z]))
    assert "N" not in bone_landmarks(plain, 0.0, sellion).points


def test_a_nose_that_the_scan_cuts_off_has_neither_root_nor_tip(face):
    x, y, z = face._patient.skin_points.T
    front = face.landmarks.positions[LANDMARKS.index("sellion"), 1] + 2  # where the field of view ends
    cut = FaceMeasures(replace(face._patient, skin_points=np.column_stack([x, np.maximum(y, front), z])))
    lost = np.isnan(cut.landmarks.positions).any(axis=1) & ~np.isnan(face.landmarks.positions).any(axis=1)
    assert [LANDMARKS[row] for row in np.flatnonzero(lost)] == ["sellion", "pronasale", "columella"]
    rows = {row.name: row.before for row in cut.rows(np.zeros_like(cut._patient.points))}
    assert np.isnan([rows[name] for name in ("a_forward", "upper_lip_e_line", "nasolabial")]).all()
    assert np.isfinite(rows["alar_width"])
    drawing = cut.tracing(REST, np.zeros_like(cut._patient.points))
    assert not any(words in drawing for words in ("nan", ">N′<", ">Prn<")) and ">A′<" in drawing


@pytest.mark.parametrize(("kind", "seen"), [("class_ii", True), ("class_iii", False)])
def test_the_chin_of_a_bent_head_is_where_it_was_or_left_out(kind, seen):
    face, turn = FaceMeasures(face_alone(kind)), Rotation.from_euler("x", 25, degrees=True)  # chin to the chest
    patient, rest = face._patient, face._cephalogram.bone.under(REST)
    bent = replace(patient, bone_points=turn.apply(patient.bone_points))
    points = bone_landmarks(bent, 0.0, turn.apply(face.landmarks.positions[0])).points
    assert ("Pog" in points) == ("B" in points) == seen and "N" in points
    assert not seen or np.linalg.norm(points["Pog"][0][0] - turn.apply(rest["Pog"])) < 4


def drawn(text: str, colour: str, width: float) -> list[np.ndarray]:
    """Places of the lines of a colour and a width."""
    ways = re.findall(f'd="M([^"]+)" fill="none" stroke="{colour}" stroke-width="{width}"/>', text)
    return [np.array([pair.split() for pair in re.split("[LM]", way)], float) for way in ways]


def test_the_drawing_goes_with_plan_and_field(face):
    still, moved = np.zeros((len(face._patient.points), 3)), np.tile([0.0, -3, 0], (len(face._patient.points), 1))
    before, after = face.tracing(REST, still), face.tracing(FORWARD, moved)
    for text in (before, after):
        ElementTree.fromstring(text)
        assert all(f">{title}</text>" in text for title in (*SKIN_MARKS.values(), "Pog", "Go"))
    (planned,) = drawn(after, PLANNED, 0.55)  # the maxilla alone
    assert not drawn(before, PLANNED, 0.55)
    np.testing.assert_allclose(planned - drawn(after, BEFORE, 0.55)[0] - [4, 0], 0, atol=0.11)
    skins = [drawn(after, colour, 0.7)[0] for colour in (PREDICTED, BEFORE)]
    np.testing.assert_allclose(skins[0] - skins[1] - [3, 0], 0, atol=0.11)
    assert len(skins[0]) > 100
