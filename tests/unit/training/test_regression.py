"""Regression from few patients: what form it takes, and what it predicts."""

import numpy as np
import pytest

from pinnochio.training.regression import regress

OWNERS = np.repeat(np.arange(32), 2)
ALIKE = np.zeros(6, int)  # all features in one group


@pytest.fixture
def rows():
    return np.random.default_rng(0).normal(size=(64, 6)) * [1, 2, 3, 4, 5, 6] + 10


def test_values_that_nothing_decides_get_their_mean(rows):
    values = np.random.default_rng(1).normal(size=(64, 5)) + 3
    fit = regress(rows, ALIKE, values, OWNERS)
    assert fit.form == "mean" and fit.error < 0.15
    np.testing.assert_allclose(fit(rows[0]), values.mean(axis=0))


def test_what_is_no_more_than_chance_is_not_predicted(rows):
    values = np.repeat(np.random.default_rng(1).normal(size=(32, 50)), 2, axis=0)
    fit = regress(rows, ALIKE, values, OWNERS)
    assert fit.form == "zero" and fit.error == 1 and not fit(rows[0]).any()


def test_what_is_linear_is_fitted_and_said_of_new_rows(rows):
    rng = np.random.default_rng(2)
    slope = rng.normal(size=(6, 4))
    values = rows @ slope + 0.1 * rng.normal(size=(64, 4))
    fit = regress(rows, ALIKE, values, OWNERS)
    assert fit.form == "linear" and fit.error < 0.01
    new = rng.normal(size=6) * [1, 2, 3, 4, 5, 6] + 10
    np.testing.assert_allclose(fit(new), new @ slope, atol=1.5)


def test_what_is_bent_asks_for_the_kernel(rows):
    values = np.cos(0.5 * (rows[:, :1] - 10)) * [1, -2]
    fit = regress(rows[:, :1], ALIKE[:1], values, OWNERS)
    assert fit.form in ("kernel", "both") and fit.error < 0.1
    assert np.abs(fit(np.array([10.0])) - [1, -2]).max() < 0.3


def test_rows_of_one_owner_do_not_foretell_each_other():
    """Owners whose two rows are alike and whose values are their own: nothing is learnt from others."""
    rng = np.random.default_rng(3)
    rows, values = (np.repeat(rng.normal(size=(32, width)), 2, axis=0) for width in (8, 3))
    assert regress(rows, np.zeros(8, int), values, OWNERS).error > 0.95


def test_a_group_counts_once_however_many_features_it_has(rows):
    """Thirty features of noise beside the one that decides: in a group of their own they hide it less."""
    rng = np.random.default_rng(4)
    described = np.column_stack([rows[:, 0], rng.normal(size=(64, 30))])
    values = (rows[:, :1] - 10) * [1, 2] + 0.3 * rng.normal(size=(64, 2))
    apart, together = (regress(described, group, values, OWNERS).error for group in ([0] + 30 * [1], 31 * [0]))
    assert apart < 0.8 * together < 0.8


def test_what_is_not_known_counts_as_usual(rows):
    values = rows[:, :2] + 0.0
    rows[::7, 5] = np.nan
    rows[:, 4] = np.nan
    fit = regress(rows, ALIKE, values, OWNERS)
    lacking = rows[1].copy()
    np.testing.assert_allclose(fit(lacking), values[1], atol=0.5)
    usual = np.where(np.isnan(lacking), fit.mean, lacking)
    np.testing.assert_allclose(fit(lacking), fit(usual))


def test_of_one_owner_nothing_is_learned(rows):
    fit = regress(rows, ALIKE, rows[:, :2] + 1.0, np.zeros(64, int))
    assert fit.form == "zero" and fit.error == 1


def test_the_form_is_chosen_by_what_errors_cost(rows):
    """Values of which a large one is chance and a small one linear: what counts says what is taken."""
    rng = np.random.default_rng(5)
    values = np.column_stack([10 * np.repeat(rng.normal(size=32), 2), 0.1 * (rows[:, 0] - 10)])
    assert regress(rows, ALIKE, values, OWNERS).form == "zero"
    fit = regress(rows, ALIKE, values, OWNERS, lambda errors: np.square(errors[:, 1]))
    assert fit.form != "zero" and fit.error < 0.2
    assert regress(rows, ALIKE, values, OWNERS, lambda errors: np.square(errors[:, 0])).form == "zero"


@pytest.mark.parametrize(("mean", "form"), [(0.25, "zero"), (0.6, "mean")])
def test_a_gain_within_its_standard_error_is_not_taken(rows, mean, form):
    """Of 32 values that spread by one, a mean of 0.25 lowers the cost by 4 %: less than is told apart."""
    sizes = np.random.default_rng(6).normal(size=32)
    values = np.repeat(mean + (sizes - sizes.mean()) / sizes.std(), 2)[:, None]
    assert regress(rows, ALIKE, values, OWNERS).form == form
