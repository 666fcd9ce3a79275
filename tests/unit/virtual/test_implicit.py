"""Implicit shapes against closed forms."""

import numpy as np
import pytest

from pinnochio.virtual.implicit import Field, ellipsoid, plate, smooth_minimum, tube, wall

AXES = [np.arange(-20.0, 21.0)] * 3
GRID = np.meshgrid(*AXES, indexing="ij")


def painted(*shapes, reach=40.0, **options):
    return Field(AXES, reach).union(*shapes, **options).values


def test_sphere_and_capsule_are_exact_distances():
    x, y, z = GRID
    sphere = painted(ellipsoid([1, 2, 3], [5, 5, 5]))
    assert np.allclose(sphere, np.sqrt((x - 1) ** 2 + (y - 2) ** 2 + (z - 3) ** 2) - 5, atol=1e-4)
    capsule = painted(tube([[-6, 0, 0], [6, 0, 0]], 2.0))
    assert np.allclose(capsule, np.sqrt((x - np.clip(x, -6, 6)) ** 2 + y**2 + z**2) - 2, atol=1e-4)


@pytest.mark.parametrize("tilt", [0.0, 30.0])
def test_ellipsoid_volume(tilt):
    fine = [np.arange(-16, 16.1, 0.5)] * 3
    inside = Field(fine, 10).union(ellipsoid([0, 0, 0], [6, 10, 14], tilt)).values < 0
    assert inside.sum() / 8 == pytest.approx(4 / 3 * np.pi * 6 * 10 * 14, rel=0.01)


def test_wall_and_plate_are_rounded_boxes():
    """Both are boxes with sides 2t, the line's extent and the height; corners rounded off."""
    line = np.stack([np.arange(-8.0, 9.0), np.zeros(17)], 1)
    upright = painted(wall(line, 3.0, -5.0, 7.0, rounding=1.0))
    x, y, z = GRID
    middle = np.abs(x) <= 8
    expected = np.maximum(np.abs(y) - 3, np.abs(z - 1) - 6)
    flat = middle & (expected <= -1)
    assert np.allclose(upright[flat], expected[flat], atol=1e-4)
    square = np.array([[-7.0, -7], [7, -7], [7, 7], [-7, 7]])
    sheet = painted(plate(square, lambda y, z: 0.0 * y, 3.0, rounding=1.0))
    expected = np.maximum(np.abs(x) - 3, np.maximum(np.abs(y), np.abs(z)) - 7)
    assert np.allclose(sheet[expected <= -1], expected[expected <= -1], atol=1e-4)


def test_smooth_minimum():
    a, b = np.float32([0.0, 1.0, 5.0]), np.float32([0.0, 3.0, 0.0])
    assert smooth_minimum(a, b, 4.0) == pytest.approx([-1.0, 0.75, 0.0])
    assert smooth_minimum(a, b, 0.0) == pytest.approx([0.0, 1.0, 0.0])


def test_block_evaluation_changes_no_surface():
    """A short reach gives the same inside as evaluating everywhere."""
    shapes = ellipsoid([3, 0, 0], [6, 4, 5]), tube([[-9, 2, 1], [0, 0, 8]], [3, 2])
    near, far = (painted(*shapes, reach=reach, k=3) for reach in (5.0, 40.0))
    assert np.allclose(near[far < 1], far[far < 1], atol=1e-3) and near[far >= 1].min() > 0.99


def test_subtract_and_brush():
    ball = Field(AXES, 40).union(ellipsoid([0, 0, 0], [9, 9, 9]))
    before = ball.values.copy()
    ball.brush([[0, -9, 0]], 1.5, 3.0)
    assert (before - ball.values)[20, 11, 20] == pytest.approx(1.5) and np.array_equal(
        before[20, 35], ball.values[20, 35]
    )
    hollow = Field(AXES, 40).union(ellipsoid([0, 0, 0], [9, 9, 9])).subtract(ellipsoid([0, 0, 0], [4, 4, 4]))
    assert hollow.values[20, 20, 20] > 0 > hollow.values[20, 20, 26]
