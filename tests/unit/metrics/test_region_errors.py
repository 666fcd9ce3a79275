"""Errors by region and landmark: heads that are moved by known amounts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.geometry.triangles import sample_surface
from pinnochio.metrics.region_errors import LANDMARKS, REGIONS, SHOWN, landmark_points, region_errors
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.regions import CHIN, NAMES, NOT_JUDGED, regions
from tests.helpers.virtual_heads import face_alone


@pytest.fixture(scope="module")
def patient():
    return face_alone("class_ii")


@pytest.fixture(scope="module")
def codes(patient):
    return regions(patient)


def errors(patient, codes, moved, target):
    """Errors at samples of the target, each in the region that the skin has there before surgery."""
    samples = sample_surface(target, patient.skin_faces[patient.face_roi], 5000, 1)
    region = codes[cKDTree(target).query(samples)[1]]
    return region_errors(region, -signed_distances(samples, moved, patient.skin_faces))


def test_the_same_skin_has_no_error_and_every_region_is_there(patient, codes):
    values = errors(patient, codes, patient.skin_points, patient.skin_points)
    assert list(values) == [f"{kind}_{name}" for name in SHOWN for kind in ("region", "bias")]
    assert len(REGIONS) == 6 and "other" not in SHOWN and set(SHOWN) - set(REGIONS) == {"neck"}
    np.testing.assert_allclose(list(values.values()), 0, atol=1e-9)


def test_a_ball_in_a_ball_is_the_gap_away_and_outside_is_positive(patient):
    """The skin as a sphere: what is 2 mm larger than its target lies 2 mm outside, in every region."""
    centre = patient.skin_points.mean(axis=0)
    away = patient.skin_points - centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    codes = (np.arange(len(away)) % len(NAMES)).astype(np.int8)
    ball = replace(patient, face_roi=np.ones_like(patient.face_roi))
    for gap in (2.0, -1.5):
        values = errors(ball, codes, centre + (60 + gap) * away, centre + 60 * away)
        for name in SHOWN:
            assert values[f"bias_{name}"] == pytest.approx(gap, abs=0.1)
            assert values[f"region_{name}"] == pytest.approx(abs(gap), abs=0.1)


def test_a_chin_that_comes_too_far_forward_is_the_chins_error_alone(patient, codes):
    height = face_landmarks(patient).sublabiale[2]
    ahead = np.clip((height - patient.skin_points[:, 2]) / 5, 0, 1)[:, None] * [0, -3.0, 0]
    values = errors(patient, codes, patient.skin_points + ahead, patient.skin_points)
    back = errors(patient, codes, patient.skin_points - ahead, patient.skin_points)
    assert 1 < values["bias_chin"] <= values["region_chin"] < 3
    assert back["bias_chin"] < -1
    assert values["region_nose"] == pytest.approx(0, abs=1e-9) == values["region_upper_lip"]


def test_a_region_without_a_sample_has_no_error():
    values = region_errors(np.array([CHIN, CHIN, NOT_JUDGED]), np.array([1.0, -3.0, 50.0]))
    assert (values["region_chin"], values["bias_chin"]) == (2, -1)
    assert np.isnan(values["region_nose"]) and np.isnan(values["bias_nose"])


def test_landmarks_are_read_at_their_places(patient):
    marks, points = face_landmarks(patient), landmark_points(patient)
    assert tuple(points) == LANDMARKS
    places = {name: patient.skin_points[point] for name, point in points.items()}
    for name in ("pronasale", "subnasale", "labrale_inferius", "pogonion", "menton"):
        assert places[name][2] == pytest.approx(getattr(marks, name)[2], abs=2.5)
    assert places["cheilion_right"][0] < -10 < 10 < places["cheilion_left"][0]


def test_a_face_that_cannot_be_read_is_refused(patient):
    blank = replace(patient, bone_segment=np.full_like(patient.bone_segment, -1), segments=())
    with pytest.raises(InputError, match="cannot be read"):
        landmark_points(blank)
