"""Covariates are their seed, and have their distributions."""

import json

import numpy as np
import pytest

from pinnochio.seeds import generator
from pinnochio.virtual.covariates import BMI, Covariates, sample_covariates, thickness_scores
from pinnochio.virtual.published_thickness import PUBLISHED

ANATOMY = {"sex": "female", "thickness": {name: known.mean for name, known in PUBLISHED.items()}}


def drawn(anatomy, reality, count=600):
    return [sample_covariates(anatomy, reality, generator(3, "sample_covariates", f"V{n}")) for n in range(count)]


def test_covariates_are_their_seed(tmp_path):
    one, other, again = (sample_covariates(ANATOMY, "clinic", generator(seed, "c", "V1")) for seed in (1, 2, 1))
    assert one == again != other
    one.write(tmp_path / "c.json")
    assert Covariates.read(tmp_path / "c.json") == one
    assert list(json.loads((tmp_path / "c.json").read_text())) == ["sex", "age", "bmi", "months", "closure", "cinch"]


def test_months_are_those_of_the_reality_and_the_rest_is_the_same():
    clinic, later = drawn(ANATOMY, "clinic"), drawn(ANATOMY, "same_modality")
    assert np.mean([c.months for c in clinic]) == pytest.approx(6, abs=0.2)
    assert np.mean([c.months for c in later]) == pytest.approx(12, abs=0.3)
    assert [(c.age, c.bmi, c.closure, c.cinch) for c in clinic] == [(c.age, c.bmi, c.closure, c.cinch) for c in later]


def test_thick_cheeks_go_with_body_mass():
    thick = {name: known.mean + 2 * known.sd for name, known in PUBLISHED.items()}
    heavy = drawn(ANATOMY | {"thickness": thick}, "clinic")
    usual = drawn(ANATOMY, "clinic")
    assert np.mean([c.bmi for c in heavy]) - np.mean([c.bmi for c in usual]) == pytest.approx(BMI[1], rel=0.2)
    assert np.std([c.bmi for c in usual]) == pytest.approx(0.866 * BMI[1], rel=0.12)


def test_a_landmark_without_bone_counts_as_usual():
    scores = thickness_scores({"cheek": None, "masseter": PUBLISHED["masseter"].mean + PUBLISHED["masseter"].sd})
    assert scores["cheek"] == 0 and scores["masseter"] == pytest.approx(1) and set(scores) == set(PUBLISHED)
