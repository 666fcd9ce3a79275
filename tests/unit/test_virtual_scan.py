"""Scans: recoverable frame, noise of the asked size, lost borders; the lips' own change."""

import numpy as np
import pytest

from pinnochio.virtual.scan import border_vertices, lip_change, scan, smooth_noise, vertex_normals


def dome(count=41, radius=80.0):
    """Front half of a sphere as a triangle grid, outward normals towards -y."""
    u = np.linspace(-1.3, 1.3, count)
    a, b = (grid.ravel() for grid in np.meshgrid(u, 0.8 * u, indexing="ij"))
    points = radius * np.stack([np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b), np.sin(b)], 1)
    i = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + count, i + count + 1], 1), np.stack([i, i + count + 1, i + 1], 1)])
    return points, faces


def test_normals_point_outward():
    points, faces = dome()
    assert np.sum(vertex_normals(points, faces) * points / 80, 1).min() > 0.99


def test_frame_is_recoverable_and_not_trivial():
    points, faces = dome()
    result = scan(points, faces, np.random.default_rng(0))
    assert np.linalg.norm(result.points - points[result.vertex], axis=1).mean() > 3
    back = result.frame.inverse(result.points) - points[result.vertex]
    assert np.abs(back).mean() < 0.4
    clean = scan(points, faces, np.random.default_rng(0), noise_mm=0, correlated_mm=0)
    assert np.allclose(clean.frame.inverse(clean.points), points[clean.vertex], atol=1e-9)
    assert np.array_equal(np.sort(points[clean.vertex][clean.faces], 1).shape, (len(clean.faces), 3, 3))


def test_noise_is_along_the_normals_and_of_the_asked_size():
    points, faces = dome(81)
    result = scan(points, faces, np.random.default_rng(1), noise_mm=0.3, correlated_mm=0.0)
    error = result.frame.inverse(result.points) - points[result.vertex]
    along = np.sum(error * vertex_normals(points, faces)[result.vertex], 1)
    assert along.std() == pytest.approx(0.3, rel=0.05)
    assert np.linalg.norm(error, axis=1).std() == pytest.approx(np.abs(along).std(), rel=1e-6)


def test_correlated_noise_has_its_length():
    """Correlation of many fields over the distance d is exp(-(d / length)^2 / 2)."""
    points = np.stack([np.arange(0, 25.0, 5), np.zeros(5), np.zeros(5)], 1)
    rng = np.random.default_rng(2)
    fields = np.array([smooth_noise(points, rng, 8.0) for _ in range(4000)])
    expected = np.exp(-((points[:, 0] / 8) ** 2) / 2)
    assert np.allclose(np.corrcoef(fields.T)[0], expected, atol=0.06)
    assert np.allclose(fields.std(0), 1, atol=0.05)


def test_border_and_blind_parts_are_lost():
    points, faces = dome()
    result = scan(points, faces, np.random.default_rng(0), border_mm=10.0)
    border = points[border_vertices(faces)]
    kept = points[result.vertex]
    assert np.linalg.norm(kept[:, None] - border, axis=2).min() >= 10.0
    assert 0.3 * len(points) < len(kept) < 0.9 * len(points)
    away = points * [1, -1, 1]  # the same dome seen from behind
    with pytest.raises(ValueError, match="no triangle faces the cameras"):
        scan(away, faces[:, [0, 2, 1]], np.random.default_rng(0), grazing=0.95)


def test_same_seed_same_scan():
    points, faces = dome()
    one, two = (scan(points, faces, np.random.default_rng(4)) for _ in range(2))
    assert one.points.tobytes() == two.points.tobytes() and one.faces.tobytes() == two.faces.tobytes()


def test_lip_change_is_local_and_of_the_asked_size():
    marks = {
        "labrale_superius": np.array([0.0, -108, -45]),
        "labrale_inferius": np.array([0.0, -105, -60]),
        "subnasale": np.array([0.0, -104, -27]),
        "cheilion_left": np.array([25.0, -95, -52]),
        "cheilion_right": np.array([-25.0, -95, -52]),
    }
    wing = marks["subnasale"] + [0.34 * 50, 4, 4]
    points = np.array([marks["labrale_superius"], marks["labrale_inferius"], wing, [0, -95, 30.0], wing * [-1, 1, 1]])
    change = lip_change(points, marks)
    assert change[0, 1] == pytest.approx(0.8, abs=0.25) and change[1, 1] == pytest.approx(0.5, abs=0.25)
    assert (
        change[1, 2] > 0.2
        and change[2, 0] == pytest.approx(1.0, abs=0.15)
        and change[4, 0] == pytest.approx(-change[2, 0])
    )
    assert np.linalg.norm(change[3]) < 1e-6
    assert np.allclose(lip_change(points, marks, 0, 0, 0), 0)
    assert np.allclose(lip_change(points, marks, weight=np.zeros(len(points))), 0)
