"""Lips that a field lets cross are shown in contact, and by how much they crossed is said."""

from dataclasses import replace

import numpy as np

from pinnochio.model.patient import LOWER_LIP, UPPER_LIP
from pinnochio.model.touching_lips import shown_skin, touching_lips
from tests.helpers.patients import tiny_patient


def block():
    """A block of layers 5 mm apart, shaken by 0.5; the second from below is a lower lip, the third an upper one."""
    patient = tiny_patient()
    layer = np.rint((patient.points[:, 2] - 40) / 5)
    lip = np.select([layer == 1, layer == 2], [LOWER_LIP, UPPER_LIP]).astype(np.int8)
    return replace(patient, lip=lip), layer


def test_lips_that_cross_meet_halfway_and_what_is_far_stays():
    patient, layer = block()
    field = np.zeros_like(patient.points)
    field[layer <= 1, 2] = 8.0  # 3 mm through the upper lip
    touching, crossed = touching_lips(patient, field)
    assert 2 < crossed < 4.5 and touching_lips(patient, touching)[1] < 0.3
    change = touching - field
    assert not change[:, :2].any() and (change[layer == 2, 2] >= 0).all() and (change[layer == 1, 2] <= 0).all()
    assert (
        1 < change[layer == 2, 2].mean() < 2.3 and 0 < change[layer == 3, 2].mean() < 0.8 * change[layer == 2, 2].mean()
    )
    np.testing.assert_array_equal(shown_skin(patient, field), patient.moved_skin(touching))


def test_lips_that_part_and_meshes_without_a_slit_stay_as_they_are():
    patient, layer = block()
    field = np.zeros_like(patient.points)
    field[layer <= 1, 2] = -3.0
    for one, moved in ((patient, field), (patient, 0 * field), (tiny_patient(), -field)):
        touching, crossed = touching_lips(one, moved)
        assert crossed == 0
        np.testing.assert_array_equal(touching, moved)
