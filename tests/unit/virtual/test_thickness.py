"""Soft-tissue thickness measured on the labels: the measurement itself, the cohort against the literature, classes."""

import json

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.virtual.head import Head
from pinnochio.virtual.published_thickness import PUBLISHED
from pinnochio.virtual.rays import Ray
from pinnochio.virtual.thickness import along_ray
from studies.cohort_checks.thickness import TABLE, tabulate
from tests.helpers.tables import write


@pytest.mark.parametrize("inward", [[0.0, 1, 0], [0.6, 0.8, 0]])
def test_a_slab_has_its_thickness(inward):
    """Bone behind 10 mm of tissue, along the normal and along an oblique ray; nothing where there is no bone."""
    labels = np.zeros((30, 50, 30), np.uint8)
    labels[:, 12:22], labels[:, 22:30] = 1, 11
    labels[:, 12:22, 10:20] = 2
    head = Head(labels, np.ones(3), np.zeros(3), {}, None)
    middle = np.array([15.0, 25, 15])
    measured = along_ray(head, Ray(middle, np.array(inward)))
    assert measured == pytest.approx(10 / inward[1], abs=0.15)
    empty = Head(np.where(labels == 11, 1, labels), np.ones(3), np.zeros(3), {}, None)
    assert np.isnan(along_ray(empty, Ray(middle, np.array(inward))))


def test_the_table_and_a_landmark_without_bone(tmp_path):
    values = [dict.fromkeys(PUBLISHED, 10.0), dict.fromkeys(PUBLISHED, 12.0) | {"menton": None}]
    path, patients = tmp_path / "thickness.csv", [tmp_path / "a.json", tmp_path / "b.json"]
    for patient, thickness in zip(patients, values, strict=True):
        patient.write_text(json.dumps({"thickness": thickness}))
    write(tabulate(patients, "test cohort"), path)
    frame = read_table(path, TABLE).set_index("landmark")
    assert frame.loc["pogonion", "ours_mean"] == 11 and frame.loc["pogonion", "ours_sd"] == pytest.approx(1.41)
    assert frame.loc["subnasale", "difference_sd"] == pytest.approx(-4.6 / 2.4, abs=0.006)
    assert frame.loc["menton", "n"] == 1 and frame.loc["menton", "ours_mean"] == 10
    assert "| pogonion | 11.00 ± 1.41 | 11.0 ± 2.3 | +0.00 | 2 | [R] |" in (tmp_path / "thickness.md").read_text()
    assert (tmp_path / "thickness.tex").stat().st_size and (tmp_path / "thickness.html").stat().st_size
