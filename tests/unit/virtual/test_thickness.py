"""Soft-tissue thickness measured on the labels: the measurement itself, the cohort against the literature, classes."""

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.seeds import generator
from pinnochio.virtual.head import Head, build_head
from pinnochio.virtual.parameters import DEFORMITIES, sample_parameters
from pinnochio.virtual.skin import Ray
from pinnochio.virtual.thickness import PUBLISHED, TABLE, along_ray, measure, summarise, table
from tests.helpers.tables import write


@pytest.fixture(scope="module")
def cohort():
    """Eight patients, two of each class: sampled parameters and what is measured on labels of 1.5 mm."""
    cases = [(n, DEFORMITIES[n % 4]) for n in range(8)]
    parameters = [sample_parameters(generator(1, "thickness", f"T{n}"), deformity) for n, deformity in cases]
    return parameters, [measure(build_head(p, 1.5)) for p in parameters]


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


def test_cohort_means_lie_within_one_published_deviation(cohort):
    frame = summarise(cohort[1]).set_index("landmark")
    assert set(frame.index) == set(PUBLISHED) and (frame["n"] == 8).all()
    assert frame["difference_sd"].abs().max() < 1
    assert frame["difference_sd"].abs().mean() < 0.4


def test_each_patient_has_the_sampled_thickness(cohort):
    """What is measured differs from what was sampled by less than the voxels make, on average and at worst."""
    for name in PUBLISHED:
        miss = np.array([measured[name] - getattr(p, name) for p, measured in zip(*cohort, strict=True)])
        assert np.abs(miss).mean() < 1.2 and np.abs(miss).max() < 2.6, name


def test_classes_and_sexes_differ_as_published():
    """Class III: upper lip thickest, lower thinnest; Class II: lower lip thickest; men thicker [S: KJO 42:23]."""
    sampled = {d: [sample_parameters(np.random.default_rng((n, k)), d) for n in range(150)]
               for k, d in enumerate(DEFORMITIES)}  # fmt: skip
    upper, lower = ({d: np.mean([getattr(p, f"labrale_{which}") for p in ps]) for d, ps in sampled.items()}
                    for which in ("superius", "inferius"))  # fmt: skip
    assert max(upper, key=upper.get) == "class_iii" and min(lower, key=lower.get) == "class_iii"
    assert max(lower, key=lower.get) == "class_ii"
    everyone = sum(sampled.values(), [])
    for name in set(PUBLISHED) - {"zygoma", "cheek"}:  # there they hardly differ
        men, women = (np.mean([getattr(p, name) for p in everyone if p.male is male]) for male in (True, False))
        assert men > women, name


def test_the_same_patient_in_another_class_shows_it_on_the_labels():
    measured = {d: measure(build_head(sample_parameters(np.random.default_rng(4), d), 1.5))
             for d in ("class_ii", "class_iii")}  # fmt: skip
    assert measured["class_iii"]["labrale_superius"] > measured["class_ii"]["labrale_superius"] + 0.5
    assert measured["class_iii"]["labrale_inferius"] < measured["class_ii"]["labrale_inferius"] - 1.5


def test_the_table_and_a_landmark_without_bone(tmp_path):
    values = [dict.fromkeys(PUBLISHED, 10.0), dict.fromkeys(PUBLISHED, 12.0) | {"menton": None}]
    path = tmp_path / "thickness.csv"
    write(table(summarise(values), "test cohort"), path)
    frame = read_table(path, TABLE).set_index("landmark")
    assert frame.loc["pogonion", "ours_mean"] == 11 and frame.loc["pogonion", "ours_sd"] == pytest.approx(1.41)
    assert frame.loc["subnasale", "difference_sd"] == pytest.approx(-4.6 / 2.4, abs=0.006)
    assert frame.loc["menton", "n"] == 1 and frame.loc["menton", "ours_mean"] == 10
    assert "| pogonion | 11.00 ± 1.41 | 11.0 ± 2.3 | +0.00 | 2 | [R] |" in (tmp_path / "thickness.md").read_text()
    assert (tmp_path / "thickness.tex").stat().st_size and (tmp_path / "thickness.html").stat().st_size
