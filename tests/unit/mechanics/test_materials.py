"""Constants and the extension of ln J below small volume ratios."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.mechanics.elements.materials import EXTENSION, Material, lame, neo_hookean
from pinnochio.mechanics.elements.tetrahedra import extended_log


def test_lame_gives_back_the_bulk_modulus():
    mu, lam = lame(6.0, 0.49)
    assert lam + 2 * mu / 3 == pytest.approx(6.0 / (3 * (1 - 2 * 0.49)))
    assert lam / mu == pytest.approx(49)


def test_neo_hookean_puts_each_tissue_where_it_is():
    law = neo_hookean(np.array([2, 1, 2]), {1: 4.0, 2: 6.0}, 0.49, {2: 1.0})
    np.testing.assert_allclose(law.mu, [2.013, 1.342, 2.013], atol=5e-4)
    np.testing.assert_allclose(law.lam, [98.66, 65.77, 98.66], atol=5e-3)
    np.testing.assert_array_equal(law.stiffening, [1, 0, 1])


@pytest.mark.parametrize(
    "make",
    [
        lambda: neo_hookean(np.array([1, 3]), {1: 4.0}, 0.49),
        lambda: neo_hookean(np.array([1]), {1: 4.0}, 0.5),
        lambda: neo_hookean(np.array([1]), {1: -4.0}, 0.49),
        lambda: Material(np.ones(2), np.ones(3), np.zeros(2)),
        lambda: Material(np.ones(2), np.array([1, np.nan]), np.zeros(2)),
    ],
)
def test_bad_constants_are_refused(make):
    with pytest.raises(InputError):
        make()


def test_extension_joins_with_two_derivatives_and_its_derivative_is_consistent():
    below, above = (np.array(extended_log(EXTENSION + s * 1e-10, EXTENSION)) for s in (-1, 1))
    np.testing.assert_allclose(below, above, rtol=1e-8)
    np.testing.assert_allclose(above, [np.log(EXTENSION), 1 / EXTENSION, -1 / EXTENSION**2], rtol=1e-8)
    for j in (-2.0, -0.1, 0.0, 0.1, 0.19, 0.21, 1.0, 2.0):
        low, mid, high = (np.array(extended_log(j + s, EXTENSION)) for s in (-1e-6, 0, 1e-6))
        np.testing.assert_allclose((high - low)[:2] / 2e-6, mid[1:], rtol=1e-6)
    assert extended_log(1.7, EXTENSION)[0] == np.log(1.7)
