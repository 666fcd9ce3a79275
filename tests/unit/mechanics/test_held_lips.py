"""Lips that a field lets cross are in contact, and those that were closed close again; by how much is said."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.mechanics.held_lips import CLOSING, held_lips, shown_skin
from pinnochio.model.patient import FIXED, FREE, LOWER_LIP, MOVING, UPPER_LIP
from tests.helpers.patients import tiny_patient


def mouth(slit=0.5):
    """A block of layers 5 mm apart, shaken by 0.5, that a slit cuts in two; its sides a lower and an upper lip."""
    patient = tiny_patient(shape=(9, 7, 6))
    layer = np.rint((patient.points[:, 2] - 40) / 5)
    lip = np.select([layer == 2, layer == 3], [LOWER_LIP, UPPER_LIP]).astype(np.int8) * (patient.node_type == FREE)
    sides = (layer[patient.cells] > 2).any(axis=1) & (layer[patient.cells] < 3).any(axis=1)
    points = patient.points - np.outer(layer > 2, [0, 0, 5 - slit])
    points[np.isin(layer, (2, 3)), 2] = 50 + slit * (layer[np.isin(layer, (2, 3))] == 3)
    cut = replace(patient, points=points, cells=patient.cells[~sides], tissue=patient.tissue[~sides], lip=lip)
    return cut, layer > 2


def lifted(patient, lower, by):
    """A field that lifts the free nodes of one side of the slit."""
    return by * np.outer(lower & (patient.node_type == FREE), [0.0, 0.0, 1.0])


def test_lips_that_cross_come_into_contact_and_what_is_far_moves_less():
    patient, upper = mouth()
    field = lifted(patient, ~upper, 3.5)  # 3 mm through the upper lip
    held = held_lips(patient, field)
    change = (held.displacement - field)[:, 2]
    assert held.crossed == pytest.approx(3.0, abs=0.01) and held_lips(patient, held.displacement).crossed < 0.1
    for lip, sign in ((UPPER_LIP, 1), (LOWER_LIP, -1)):
        assert sign * change[patient.lip == lip].mean() > 0.25
    assert not change[np.isin(patient.node_type, (FIXED, MOVING))].any()
    beneath = change[(np.abs(patient.points[:, 2] - 45) < 1) & (patient.node_type == FREE)]
    assert 0 < -beneath.mean() < -0.7 * change[patient.lip == LOWER_LIP].mean()
    np.testing.assert_array_equal(shown_skin(patient, field, CLOSING), patient.moved_skin(held.displacement))


def test_lips_that_were_closed_close_again_as_far_as_they_may():
    patient, upper = mouth()
    held = held_lips(patient, lifted(patient, upper, 3.0))
    assert (held.before, held.parted) == pytest.approx((0.5, 3.5), abs=0.01)
    assert held.left == pytest.approx(0.5, abs=0.2)
    wide = held_lips(patient, lifted(patient, upper, 3.0 + CLOSING))
    assert wide.left == pytest.approx(wide.parted - CLOSING, abs=0.3)


@pytest.mark.parametrize(("slit", "closing"), [(2.5, CLOSING), (0.5, 0.0)])
def test_lips_that_were_open_or_that_nobody_closes_stay_apart(slit, closing):
    patient, upper = mouth(slit)
    field = lifted(patient, upper, 3.0)
    held = held_lips(patient, field, closing)
    assert held.left == held.parted == pytest.approx(3.0 + slit, abs=0.01)
    np.testing.assert_array_equal(held.displacement, field)


def test_meshes_without_a_slit_and_faces_at_rest_stay_as_they_are():
    for patient in (tiny_patient(), mouth()[0]):
        held = held_lips(patient, 0 * patient.points)
        assert held.crossed == 0 and not held.displacement.any()
