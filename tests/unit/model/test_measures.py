"""Measures of the soft tissue by hand-computed faces; their derivatives by differences; landmarks carried by a mesh."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.model.carried import NEAR, carried_landmarks, carriers
from pinnochio.model.landmarks import FaceLandmarks
from pinnochio.model.measures import LANDMARKS, MEASURES, measure
from pinnochio.model.patient import LOWER_LIP, UPPER_LIP
from tests.helpers.patients import tiny_patient

# x to the left, y backwards, z up: a profile of small whole numbers, with N' at the origin.
FACE = {
    "sellion": (0, 0, 0),
    "pronasale": (0, -20, -40),
    "columella": (0, -10, -50),
    "subnasale": (0, -5, -50),
    "subspinale": (0, -4, -55),
    "labrale_superius": (1, -5, -60),
    "stomion_superius": (0, -4, -65),
    "stomion_inferius": (0, -4, -67),
    "labrale_inferius": (0, 0, -75),
    "sublabiale": (0, 5, -80),
    "pogonion": (-3, 0, -85),
    "menton": (0, 10, -95),
    "alare_right": (-17, 5, -50),
    "alare_left": (16, 5, -50),
}
POSITIONS = np.array([FACE[name] for name in LANDMARKS], float)


def of(positions) -> dict[str, float]:
    return dict(zip(MEASURES, measure(positions), strict=True))


def test_measures_of_a_face_are_those_computed_by_hand():
    # E-line from (-20, -40) to (0, -85) in profile: across it, to the front, (-45, -20) / sqrt(45^2 + 20^2).
    length = np.hypot(45, 20)
    expected = {
        "a_forward": 4,
        "b_forward": -5,
        "pog_forward": 0,
        "upper_lip_e_line": ((-5 + 20) * -45 + (-60 + 40) * -20) / length,
        "lower_lip_e_line": (20 * -45 + -35 * -20) / length,
        "nasolabial": 90,  # columella straight ahead, lip straight below
        "mentolabial": 90,  # 5 mm up and ahead, 5 mm down and ahead
        "convexity": np.degrees(np.arctan2(5, 50) + np.arctan2(5, 35)),
        "interlabial_gap": 2,
        "alar_width": 33,
        "midline": 1,
        "chin_asymmetry": -3,
    }
    assert of(POSITIONS) == pytest.approx(expected)


def test_a_chin_in_front_is_concave_and_one_behind_convex():
    moved = POSITIONS.copy()
    moved[LANDMARKS.index("pogonion")] += [0, -12, 0]
    assert of(moved)["convexity"] == pytest.approx(np.degrees(np.arctan2(5, 50) - np.arctan2(7, 35)))
    assert of(moved)["convexity"] < 0 < of(POSITIONS)["convexity"]
    assert of(moved)["pog_forward"] == pytest.approx(12)
    assert of(moved)["lower_lip_e_line"] < of(POSITIONS)["lower_lip_e_line"]


def test_a_shift_of_the_whole_face_changes_no_measure():
    np.testing.assert_allclose(measure(POSITIONS + [3.0, -70, 12]), measure(POSITIONS), atol=1e-10)


def test_derivatives_are_those_of_the_values():
    rng = np.random.default_rng(0)
    positions, step = POSITIONS + rng.normal(0, 0.7, POSITIONS.shape), 1e-5
    for item in MEASURES.values():
        read = positions[[LANDMARKS.index(name) for name in item.points]]
        for place in np.ndindex(read.shape):
            moved = np.zeros_like(read)
            moved[place] = step
            change = (item.rule(read + moved)[0] - item.rule(read - moved)[0]) / (2 * step)
            assert item.rule(read)[1][place] == pytest.approx(change, abs=1e-6)


def test_lips_that_cross_leave_no_gap():
    positions = POSITIONS.copy()
    positions[LANDMARKS.index("stomion_inferius"), 2] += 5
    assert of(positions)["interlabial_gap"] == 0


def test_what_is_unknown_is_not_measured_and_nothing_else_is_lost():
    positions = POSITIONS.copy()
    positions[LANDMARKS.index("stomion_superius")] = np.nan
    positions[LANDMARKS.index("sublabiale")] = positions[LANDMARKS.index("pogonion")] + [0, 1, 1]
    lost = {name for name, value in of(positions).items() if np.isnan(value)}
    assert lost == {"interlabial_gap", "mentolabial"}  # no edge of a lip; no fold above the chin


def face_on_a_block():
    """A block turned so that its skin looks forward, with landmarks of a face laid down its middle and two lips."""
    patient = tiny_patient()
    points = patient.points[:, [0, 2, 1]] * [1, -1, 1]
    patient = replace(patient, points=points, skin_points=points)
    skin = points[np.unique(patient.skin_faces)]
    names = [name for name in FaceLandmarks.__dataclass_fields__ if name not in ("alare", "cheilion")]
    heights = np.linspace(skin[:, 2].max(), skin[:, 2].min(), len(names))
    marks = {name: np.array([25.0, skin[:, 1].min(), z]) for name, z in zip(names, heights, strict=True)}
    marks |= {"alare": np.array([marks["subnasale"]] * 2), "cheilion": np.array([marks["stomion"]] * 2)}
    lip = np.where(points[:, 1] > skin[:, 1].min() + 8, 0, np.where(points[:, 2] > -70, UPPER_LIP, LOWER_LIP))
    return replace(patient, lip=lip.astype(np.int8)), FaceLandmarks(**marks)


def test_landmarks_are_carried_as_the_mesh_goes():
    patient, marks = face_on_a_block()
    carried = carried_landmarks(patient, marks)
    np.testing.assert_allclose(carried.carriers.sum(axis=1), 1)
    shift = np.array([0.5, -2, 1])
    moved = carried.moved(np.tile(shift, (len(patient.points), 1)))
    np.testing.assert_allclose(moved - carried.positions, np.tile(shift, (len(LANDMARKS), 1)), atol=1e-12)
    np.testing.assert_array_equal(carried.moved(np.zeros_like(patient.points)), carried.positions)
    lips = np.where(patient.lip == UPPER_LIP, 1.0, np.where(patient.lip == LOWER_LIP, -0.5, 0))
    parted = carried.moved(lips[:, None] * [0, 0, 1.0])
    gap = [LANDMARKS.index(name) for name in ("stomion_inferius", "stomion_superius")]
    assert np.diff((parted - carried.positions)[gap, 2])[0] == pytest.approx(1.5)


def test_without_a_slit_the_edges_of_the_lips_are_unknown():
    patient, marks = face_on_a_block()
    carried = carried_landmarks(replace(patient, lip=np.zeros_like(patient.lip)), marks)
    unknown = [LANDMARKS[row] for row in np.flatnonzero(np.isnan(carried.positions).any(axis=1))]
    assert unknown == ["stomion_superius", "stomion_inferius"]
    assert not np.isnan(carried.carriers.toarray()).any()


def test_a_landmark_takes_the_mean_motion_of_the_skin_about_it():
    patient = tiny_patient()
    skin = np.unique(patient.skin_faces)
    place = patient.skin_points[skin[7]]
    field = np.random.default_rng(1).normal(size=patient.points.shape)
    near = skin[np.linalg.norm(patient.skin_points[skin] - place, axis=1) <= NEAR]
    expected = (patient.moved_skin(field) - patient.skin_points)[near].mean(axis=0)
    np.testing.assert_allclose((carriers(patient, place) @ field)[0], expected, atol=1e-12)
    far = place + [0, 0, 500.0]  # then the nearest alone counts
    assert (carriers(patient, far) > 0).sum() == 1
