"""Distances and surface metrics against closed forms."""

import numpy as np
import pytest
import pyvista as pv

from pinnochio.geometry.closest_points import closest_points, signed_distances
from pinnochio.geometry.triangles import sample_surface, vertex_areas
from pinnochio.metrics.chamfer import surface_metrics


def sphere(radius, subdivisions=4):
    mesh = pv.Icosphere(radius=1, nsub=subdivisions)
    points = np.asarray(mesh.points, float)
    return radius * points / np.linalg.norm(points, axis=1)[:, None], mesh.regular_faces.astype(np.int32)


def plate(x, y, z=0.0):
    """Plate with grid lines at x and y, facing +z."""
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    points = np.column_stack([grid, np.full(len(grid), z)]).astype(float)
    n = len(y)
    corner = (np.arange(len(x) - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack([np.column_stack([corner, corner + n, corner + n + 1]),
                       np.column_stack([corner, corner + n + 1, corner + 1])])  # fmt: skip
    return points, faces.astype(np.int32)


def metrics(predicted, target, roi=None, samples=4000, seed=1):
    """Metrics of samples that both surfaces show, judged where `roi` (f,) of the predicted one says so."""
    points, faces = predicted
    roi = np.ones(len(faces), bool) if roi is None else roi
    skin, queries = sample_surface(points, faces[roi], samples, seed), sample_surface(*target, 2 * samples, seed + 1)
    near = closest_points(queries, points, faces)
    skin = skin[~closest_points(skin, *target).border]
    return surface_metrics(points, faces, skin, *target, queries[~near.border & roi[near.face]])


@pytest.mark.parametrize(("gap", "pwr1", "pwr2"), [(0.7, 100, 100), (1.5, 0, 100), (3.0, 0, 0)])
def test_concentric_spheres_are_a_gap_apart(gap, pwr1, pwr2):
    values = metrics(sphere(50), sphere(50 + gap))
    assert values["cd"] == pytest.approx(gap, abs=0.02)
    assert values["cd_sum"] == pytest.approx(2 * values["cd"])
    assert values["cd_sq"] == pytest.approx(gap**2, rel=0.03)
    assert gap < values["cd_vertex"] < np.hypot(gap, 4)  # vertices lie up to 4 mm apart
    assert values["hd95"] == pytest.approx(gap, abs=0.06)
    assert values["hdmax"] == pytest.approx(gap, abs=0.1)
    assert values["hd_mean_oneway"] == pytest.approx(gap, abs=0.03)
    assert (values["pwr1"], values["pwr2"], values["pwr1_target"], values["pwr2_target"]) == (pwr1, pwr2, pwr1, pwr2)


def test_a_plane_moved_along_its_normal_is_exactly_that_far():
    lines = np.linspace(0, 40, 9)
    values = metrics(plate(lines, lines), plate(lines, lines, 1.5))
    for name in ("cd", "hd95", "hdmax", "hd_mean_oneway"):
        assert values[name] == pytest.approx(1.5, abs=1e-9)
    assert values["cd_sq"] == pytest.approx(2.25, abs=1e-9)
    assert (values["pwr1"], values["pwr2"]) == (0, 100)


def test_directions_differ_and_are_averaged_or_maximised():
    """A plate under a ramp z = x/10: distances are known; half, sum, square and maximum follow their definitions."""
    lines = np.linspace(0, 40, 9)
    flat, ramp = plate(lines, lines), plate(lines, lines)
    ramp[0][:, 2] = ramp[0][:, 0] / 10
    values = metrics(flat, ramp, samples=40000)
    sine = 1 / np.hypot(1, 10)
    # flat -> ramp: x sin(a); ramp -> flat: x / 10; borders (x = 40 / cos^2 and outer rims) cost a little.
    assert values["cd"] == pytest.approx((20 * sine + 2.0) / 2, rel=0.01)
    assert values["cd_sum"] == pytest.approx(2 * values["cd"])
    assert values["cd_sq"] == pytest.approx((1600 / 3 * sine**2 + 16 / 3) / 2, rel=0.02)
    assert values["hd95"] == pytest.approx(3.8, rel=0.01)
    assert values["hdmax"] == pytest.approx(4.0, rel=0.01)


def test_the_direction_that_sees_the_larger_distance_decides():
    """Target: a sheet 1 mm above the plate, and 6 mm above its left half a second one that only the target sees."""
    lines = np.linspace(-30, 30, 13)
    low, high = plate(np.linspace(-20, 20, 9), lines[2:-2], 1.0), plate(np.linspace(-20, 0, 5), lines[2:-2], 6.0)
    target = np.vstack([low[0], high[0]]), np.vstack([low[1], high[1] + len(low[0])])
    predicted = plate(lines, lines)
    roi = (np.abs(predicted[0][predicted[1]][..., :2]) <= 20).all(axis=(1, 2))
    values = metrics(predicted, target, roi, samples=20000)
    assert values["hd95"] == values["hdmax"] == pytest.approx(6)
    assert values["cd"] == pytest.approx((1 + 8 / 3) / 2, rel=0.02)
    assert values["cd_sq"] == pytest.approx((1 + 38 / 3) / 2, rel=0.03)
    assert values["pwr2"] == 100 and 55 < values["pwr2_target"] < 75


def test_distance_is_to_the_triangle_not_to_the_vertex():
    coarse = plate([0, 40], [0, 40])
    lines = np.linspace(5, 35, 31)
    fine = plate(lines, lines, 1.0)
    closest = closest_points(fine[0], *coarse)
    np.testing.assert_allclose(closest.distance, 1.0, atol=1e-9)
    np.testing.assert_allclose(closest.points[:, :2], fine[0][:, :2], atol=1e-9)
    assert not closest.border.any()


def test_share_within_is_of_the_area_not_of_the_vertices():
    """Grid lines crowd where the surfaces touch: 10% of the area but 90% of the vertices are near."""
    x = np.concatenate([np.linspace(0, 10, 91), np.linspace(10, 100, 10)[1:]])
    predicted, target = plate(x, [0, 10, 20]), plate([-9, 30, 70, 109], [-9, 10, 29])
    predicted[0][predicted[0][:, 0] > 10, 2] = 5.0
    values = metrics(predicted, target, samples=20000)
    # Of the strip from z = 0 to z = 5 a fifth lies below 1 mm; the rest is by length.
    strip = np.hypot(10, 5)
    assert values["pwr1"] == pytest.approx(100 * (10 + strip / 5) / (10 + strip + 80), abs=0.7)
    assert (predicted[0][:, 2] < 1).mean() > 0.9 and values["pwr1"] < 20


def test_vertex_areas_share_out_the_whole_area():
    points, faces = plate([0, 1, 10], [0, 3])
    areas = vertex_areas(points, faces)
    assert areas.sum() == pytest.approx(30)
    np.testing.assert_allclose(sorted(areas), sorted([1.0, 0.5, 5.5, 9.5, 9.0, 4.5]))


def test_every_sample_counts_also_beyond_an_open_border():
    """A plate of which half is missing, 1 mm lower: the other half's samples are as far as its edge, not dropped."""
    lines = np.linspace(0, 40, 21)
    whole, half = plate(lines, lines), plate(lines[:11], lines, 1.0)
    samples = sample_surface(*whole, 20000, 1)
    values = surface_metrics(*half, sample_surface(*half, 20000, 2), *whole, samples)
    beyond = np.hypot(np.maximum(samples[:, 0] - 20, 0), 1)
    assert values["hd_mean_oneway"] == pytest.approx(beyond.mean()) and values["hdmax"] > 19.9
    assert values["cd"] == pytest.approx((1 + beyond.mean()) / 2) and values["pwr2"] == 100
    assert values["pwr2_target"] == pytest.approx(100 * (beyond < 2).mean())


def test_open_borders_are_known():
    lines = np.linspace(0, 40, 21)
    half = plate(lines[:11], lines, 1.0)
    inside, over_edge, over_corner = closest_points([[10, 10, 3], [25, 10, 0], [-3, -3, 0]], *half).border
    assert not inside and over_edge and over_corner


def test_an_inner_edge_is_no_border():
    points, faces = plate([0, 10, 20], [0, 10, 20])
    closest = closest_points([[10, 5, 1], [10, 10, 1], [5, 5, 1], [0, 5, 1]], points, faces)
    np.testing.assert_array_equal(closest.border, [False, False, False, True])


def test_only_the_judged_half_counts_in_either_direction():
    """Upper half: gap 1; lower half: gap 6. The judged region is the upper half."""
    points, faces = sphere(50)
    outer = points * np.where(points[:, 2] > 0, 51, 56)[:, None] / 50
    roi = (points[faces][..., 2] > 2).all(axis=1)
    values = metrics((points, faces), (outer, faces), roi)
    assert values["cd"] == pytest.approx(1, abs=0.03)
    assert values["hdmax"] < 1.7 and values["pwr2"] == 100 and values["pwr2_target"] == 100
    below = metrics((points, faces), (outer, faces), (points[faces][..., 2] < -6).all(axis=1))
    assert below["cd"] == pytest.approx(6, abs=0.15)
    assert metrics((points, faces), (outer, faces))["cd"] == pytest.approx(3.5, abs=0.2)


def test_samples_are_uniform_in_area_seeded_and_on_the_surface():
    points, faces = plate([0, 1, 10], [0, 3])
    drawn = sample_surface(points, faces, 20000, 5)
    np.testing.assert_array_equal(drawn, sample_surface(points, faces, 20000, 5))
    assert not np.array_equal(drawn, sample_surface(points, faces, 20000, 6))
    assert np.histogram(drawn[:, 0], bins=10, range=(0, 10))[0] == pytest.approx(np.full(10, 2000), rel=0.08)
    assert np.histogram(drawn[:, 1], bins=3, range=(0, 3))[0] == pytest.approx(np.full(3, 20000 / 3), rel=0.05)
    assert (drawn[:, 2] == 0).all()


def test_signed_distances_are_negative_inside():
    points, faces = sphere(30)
    distances = signed_distances([[0, 0, 40], [10, 0, 0], [0, -30, 0]], points, faces)
    np.testing.assert_allclose(distances, [10, -20, 0], atol=0.1)
