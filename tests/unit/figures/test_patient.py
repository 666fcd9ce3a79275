"""The skin that a patient's page shows."""

import numpy as np

from pinnochio.figures.patient import LEVELLED, held_skin
from tests.helpers.patients import tiny_patient


def test_dents_of_the_field_are_levelled_a_little_and_a_translation_is_kept():
    patient = tiny_patient()
    dent = np.zeros_like(patient.points)
    dent[patient.skin_faces[40, 0]] = [0, 0, 0.3]
    used = np.unique(patient.skin_faces)
    rest, dented = (held_skin(patient, field).points for field in (0 * dent, dent))
    np.testing.assert_allclose(rest, patient.skin_points, atol=1e-6)
    left = np.abs(dented - rest)[used]
    assert 0 < left.max() < 0.15 and np.abs(dented - patient.moved_skin(dent)).max() <= LEVELLED + 1e-6
    np.testing.assert_allclose(held_skin(patient, dent * 0 + 2).points[used], patient.skin_points[used] + 2, atol=1e-5)
