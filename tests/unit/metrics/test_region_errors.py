"""Errors by region and landmark: heads that are moved by known amounts."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.metrics.regions import LANDMARKS, REGIONS, landmark_errors, region_errors
from pinnochio.metrics.surface import surface_metrics, target_samples
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.regions import CHIN, NAMES, regions
from pinnochio.virtual.head import build_head
from pinnochio.virtual.parameters import sample_parameters
from tests.helpers.patients import as_model


@pytest.fixture(scope="module")
def patient():
    return as_model(build_head(sample_parameters(np.random.default_rng(3), "class_ii"), spacing=2.0))


@pytest.fixture(scope="module")
def codes(patient):
    return regions(patient)


def errors(patient, moved, target):
    faces = patient.skin_faces
    return region_errors(patient, moved, target_samples(moved, faces, patient.face_roi, target, faces, 5000, 1))


def test_the_same_skin_has_no_error_and_every_region_is_there(patient):
    values = errors(patient, patient.skin_points, patient.skin_points)
    assert list(values) == [f"{kind}_{name}" for name in REGIONS for kind in ("region", "bias")]
    assert len(REGIONS) == 6 and "other" not in REGIONS
    np.testing.assert_allclose(list(values.values()), 0, atol=1e-9)


def test_a_ball_in_a_ball_is_the_gap_away_and_outside_is_positive(patient, monkeypatch):
    """The judged face as a sphere: what is 2 mm larger than its target lies 2 mm outside, in every region."""
    centre = patient.skin_points.mean(axis=0)
    away = patient.skin_points - centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    codes = (np.arange(len(away)) % len(NAMES)).astype(np.int8)
    monkeypatch.setattr("pinnochio.metrics.regions.regions", lambda patient: codes)
    ball = replace(patient, face_roi=np.ones_like(patient.face_roi))
    for gap in (2.0, -1.5):
        values = errors(ball, centre + (60 + gap) * away, centre + 60 * away)
        for name in REGIONS:
            assert values[f"bias_{name}"] == pytest.approx(gap, abs=0.1)
            assert values[f"region_{name}"] == pytest.approx(abs(gap), abs=0.1)


def test_a_chin_that_comes_too_far_forward_is_the_chins_error_alone(patient, codes):
    height = face_landmarks(patient).sublabiale[2]
    ahead = np.clip((height - patient.skin_points[:, 2]) / 5, 0, 1)[:, None] * [0, -3.0, 0]
    values = errors(patient, patient.skin_points + ahead, patient.skin_points)
    back = errors(patient, patient.skin_points - ahead, patient.skin_points)
    assert 1 < values["bias_chin"] <= values["region_chin"] < 3
    assert back["bias_chin"] < -1
    assert values["region_nose"] == pytest.approx(0, abs=1e-9) == values["region_upper_lip"]


def test_regions_are_means_over_the_samples_of_the_accuracy(patient, codes, monkeypatch):
    """With one region for all judged points its mean is the accuracy's mean from target to prediction."""
    target = patient.skin_points + [0.3, -1.0, 0.5]
    face = patient.skin_points, patient.skin_faces, patient.face_roi, target, patient.skin_faces, 5000, 1
    closest, kept = target_samples(*face)[1:]
    monkeypatch.setattr("pinnochio.metrics.regions.regions", lambda patient: np.full_like(codes, CHIN))
    alone = errors(patient, patient.skin_points, target)
    assert alone["region_chin"] == pytest.approx(closest.distance[kept].mean())
    assert np.isnan(alone["region_nose"]) and np.isnan(alone["bias_nose"])
    assert surface_metrics(*face)["cd"] == pytest.approx(alone["region_chin"], rel=0.1)


def test_landmarks_read_the_field_of_errors_at_their_places(patient):
    assert set(landmark_errors(patient, np.full(len(patient.skin_points), 1.7)).values()) == {1.7}
    marks = face_landmarks(patient)
    values = landmark_errors(patient, patient.skin_points[:, 2])
    assert list(values) == [f"landmark_{name}" for name in LANDMARKS]
    for name in ("pronasale", "subnasale", "labrale_inferius", "pogonion", "menton"):
        assert values[f"landmark_{name}"] == pytest.approx(getattr(marks, name)[2], abs=2.5)
    across = landmark_errors(patient, patient.skin_points[:, 0])
    assert across["landmark_cheilion_right"] < -10 < 10 < across["landmark_cheilion_left"]


def test_a_face_that_cannot_be_read_is_refused(patient):
    blank = replace(patient, bone_segment=np.full_like(patient.bone_segment, -1), segments=())
    with pytest.raises(InputError, match="cannot be read"):
        errors(blank, patient.skin_points, patient.skin_points)
    with pytest.raises(InputError, match="cannot be read"):
        landmark_errors(blank, np.zeros(len(patient.skin_points)))
