"""The face in numbers: measures before and after, their half-widths, and where landmarks go."""

from dataclasses import replace

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.model.measures import LANDMARKS, MEASURES
from pinnochio.model.regions import CHIN
from pinnochio.patients.face_measures import SHOWN, TABLE, FaceMeasures, read_face, unknown_rows, write_face, written
from pinnochio.statistics.intervals import Calibration, Interval
from tests.helpers.virtual_heads import face_alone


@pytest.fixture(scope="module")
def patient():
    return face_alone("class_ii")


@pytest.fixture(scope="module")
def face(patient):
    return FaceMeasures(patient)


def by_name(rows):
    return {row.name: row for row in rows}


def test_a_face_that_does_not_move_changes_in_nothing(patient, face):
    rows = by_name(face.rows(np.zeros_like(patient.points)))
    assert len(rows) == len(MEASURES) + 3 * len(SHOWN)
    for row in rows.values():
        assert row.change == 0 or np.isnan(row.before) and np.isnan(row.change)
        assert np.isnan(row.half_width)  # there is no interval
    assert np.isnan(rows["interlabial_gap"].before)  # no mouth slit in this mesh
    assert -15 < rows["upper_lip_e_line"].before < 5 and 70 < rows["nasolabial"].before < 150


def test_what_goes_forward_does_so_by_its_amount(patient, face):
    below = patient.points[:, 2] < face.landmarks.positions[LANDMARKS.index("labrale_inferius"), 2] + 4
    rows = by_name(face.rows(np.where(below[:, None], [1.0, -4, 0.5], 0)))
    assert (rows["pogonion_forward"].change, rows["pogonion_up"].change) == pytest.approx((4, 0.5))
    assert rows["pogonion_left"].change == pytest.approx(1)
    assert rows["pog_forward"].change == pytest.approx(4) and rows["chin_asymmetry"].change == pytest.approx(1)
    assert rows["convexity"].change < 0 and rows["pronasale_forward"].change == 0
    assert rows["upper_lip_e_line"].change < 0  # the line goes forward with the chin


def test_a_measure_has_its_half_width_wider_where_the_skin_it_is_read_at_has_a_wider_one(patient, face):
    field, chin = np.zeros_like(patient.points), patient.skin_points[:, 2] < face.landmarks.positions[8, 2]
    widths, region = np.where(chin, 1.6, 0.8), np.full(len(chin), CHIN, np.int8)
    known = Calibration("m", 0.9, 40, 5, {"chin": 0.8}, {}, dict.fromkeys(MEASURES, 5.0) | {"midline": None})
    rows = by_name(face.rows(field, Interval(field, field[:, 0], widths, region), known))
    assert rows["pogonion_up"].half_width == 1.6 and rows["subnasale_up"].half_width == 0.8  # of the skin there
    assert rows["nasolabial"].half_width == 5 and rows["alar_width"].half_width == 5
    assert rows["pog_forward"].half_width == rows["mentolabial"].half_width == 10
    assert np.isnan([rows["midline"].half_width, rows["interlabial_gap"].half_width]).all()  # no slit in this mesh
    unjudged = by_name(face.rows(field, Interval(field, field[:, 0], np.nan * widths, region - region - 1), known))
    assert unjudged["pog_forward"].half_width == 5


def test_a_face_that_cannot_be_read_has_no_numbers_and_the_table_stays(patient, tmp_path):
    bare = replace(patient, bone_segment=np.full(len(patient.bone_points), -1), segments=())
    assert read_face(bare) is None
    rows = unknown_rows()
    write_face(rows, tmp_path / "measures.csv")
    table = read_table(tmp_path / "measures.csv", TABLE)
    assert len(table) == len(rows) == len(MEASURES) + 3 * len(SHOWN) and table["after"].isna().all()


@pytest.mark.parametrize(
    ("value", "digits", "sign", "text"),
    [
        (1.26, 1, "+", "+1.3"),
        (-1.26, 1, "", "−1.3"),
        (-0.04, 1, "+", "0.0"),
        (0.04, 1, "+", "0.0"),
        (np.nan, 1, "", "–"),
    ],
)
def test_numbers_are_written_as_people_write_them(value, digits, sign, text):
    assert written(value, digits, sign) == text
