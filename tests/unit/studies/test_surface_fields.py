"""The structure of fields whose structure is known."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from pinnochio.virtual.face_scan import smooth_noise
from studies.cohort_checks.surface_fields import (
    bands,
    common_share,
    correlation_lengths,
    mirror_images,
    slope,
    smoothed,
    symmetric_share,
    without_rigid_part,
)

STEP = 2.0


@pytest.fixture(scope="module")
def plane():
    """A plane of 160 mm: points (n, 3), faces, areas (n,)."""
    line = np.arange(-80, 80 + STEP, STEP)
    x, z = (grid.ravel() for grid in np.meshgrid(line, line))
    points = np.stack([x, np.zeros_like(x), z], 1)
    return points, Delaunay(points[:, [0, 2]]).simplices, np.full(len(points), STEP**2)


def test_a_wave_passes_a_gaussian_as_its_transform_says(plane):
    points, _, areas = plane
    length, width = 40.0, 6.0
    wave = np.cos(2 * np.pi * points[:, 0] / length)
    inner = np.abs(points).max(axis=1) < 60
    left = smoothed(points, areas, wave, width)[inner]
    damped = np.exp(-0.5 * (2 * np.pi * width / length) ** 2)
    np.testing.assert_allclose(left, damped * wave[inner], atol=0.03)


def test_white_noise_lies_in_the_fine_bands_and_a_broad_wave_in_none(plane):
    points, _, areas = plane
    inner = np.abs(points).max(axis=1) < 60
    points, areas = points[inner], areas[inner]
    noise = np.random.default_rng(0).normal(size=len(points))
    fine, middle, broad = bands(points, areas, noise)
    # White noise of unit SD on a grid, under a Gaussian of SD w: STEP / (2 w sqrt(pi)).
    assert fine == pytest.approx(STEP / (2 * np.sqrt(np.pi)) * np.sqrt(1 / 2.5**2 + 1 / 36 - 4 / (6.25 + 36)), rel=0.1)
    assert fine > 2 * middle > 2 * broad
    tilted = points[:, 0] / 80
    assert bands(points, areas, without_rigid_part(points, np.tile([0.0, 1, 0], (len(points), 1)), areas, tilted)) == (
        pytest.approx([0, 0, 0], abs=1e-9)
    )


def test_the_correlation_of_a_gaussian_field_falls_as_it_was_made(plane):
    points, _, areas = plane
    lengths = []
    for seed in range(8):
        field = smooth_noise(points, np.random.default_rng(seed), 10.0, 800)
        lengths.append(correlation_lengths(points, areas, field))
    half, tenth = np.mean(lengths, axis=0)
    assert half == pytest.approx(10 * np.sqrt(2 * np.log(2)), rel=0.1)
    assert tenth == pytest.approx(10 * np.sqrt(2 * np.log(10)), rel=0.25)


def test_a_constant_field_has_no_correlation_length(plane):
    points, _, areas = plane
    with np.errstate(invalid="ignore", divide="ignore"):
        assert np.isnan(correlation_lengths(points, areas, np.ones(len(points)))).all()


def test_a_ramp_has_its_slope(plane):
    points, faces, areas = plane
    ramp = np.tan(np.radians(5)) * points[:, 2]
    inner = faces[(np.abs(points[faces]).max(axis=(1, 2)) < 70)]
    assert slope(points, inner, areas, ramp) == pytest.approx(5, abs=0.01)
    between_lips = inner[0][[0, 1, 1]]
    assert slope(points, [*inner, between_lips], areas, ramp) == pytest.approx(5, abs=0.01)


def test_even_and_odd_parts_are_separated(plane):
    points, _, areas = plane
    x = points[:, 0]
    # A surface that a mirror image fits in one way only.
    bent = points + np.stack([np.zeros_like(x), x**2 / 100, np.zeros_like(x)], 1)
    mirror = mirror_images(bent + [3.0, 0, 0])
    even, odd = np.cos(x / 20), np.sin(x / 20)
    assert symmetric_share(areas, even, mirror) == pytest.approx(1, abs=1e-6)
    assert symmetric_share(areas, odd, mirror) == pytest.approx(0, abs=1e-6)
    share = 4 * np.mean(even**2) / (4 * np.mean(even**2) + np.mean(odd**2))
    assert symmetric_share(areas, 2 * even + odd, mirror) == pytest.approx(share, abs=0.01)


def test_what_all_patients_share_is_measured(plane):
    points, _, areas = plane
    draws = np.random.default_rng(3)
    common = smooth_noise(points, draws, 15.0)
    common /= common.std()
    patients = [common + 2 * smooth_noise(points, draws, 15.0) for _ in range(30)]
    assert common_share(areas, patients) == pytest.approx(0.2, abs=0.05)
    assert common_share(areas, [common, common]) == pytest.approx(1)
