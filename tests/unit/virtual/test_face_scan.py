"""Scans: recoverable frame, noise of the asked size, lost borders, holes; each effect with its own switch."""

import numpy as np
import pytest

from pinnochio.geometry.triangles import vertex_normals
from pinnochio.virtual.face_scan import RIM, outer_border, scan, smooth_noise
from tests.helpers.heads import dome

OFF = {"noise": 0.0, "holes": 0, "coverage": None, "frame": 0.0}


def rng(seed=0):
    return np.random.default_rng(seed)


def test_everything_off_is_the_surface_itself():
    points, faces = dome()
    result = scan(points, faces, rng(), **OFF)
    assert np.array_equal(np.sort(result.vertex), np.arange(len(points)))
    assert np.allclose(result.points, points[result.vertex], atol=1e-12)
    assert len(result.faces) == len(faces)
    assert not np.array_equal(result.vertex, np.sort(result.vertex))  # geometry alone ties it to its source


def test_frame_is_recoverable_and_not_trivial():
    points, faces = dome()
    result = scan(points, faces, rng(), **OFF | {"frame": 1.0})
    assert np.linalg.norm(result.points - points[result.vertex], axis=1).mean() > 3
    assert np.allclose(result.frame.inverse(result.points), points[result.vertex], atol=1e-9)


def test_noise_is_along_the_normals_and_of_the_wished_size():
    points, faces = dome(81)
    errors = [scan(points, faces, rng(seed), **OFF | {"noise": 0.3}) for seed in range(8)]
    errors = [result.points - points[result.vertex] for result in errors]
    normals = [vertex_normals(points, faces)[scan(points, faces, rng(seed), **OFF).vertex] for seed in range(8)]
    along = np.array([np.sum(e * n, 1) for e, n in zip(errors, normals, strict=True)])
    assert along.std() == pytest.approx(0.3, rel=0.08)
    assert np.allclose(np.linalg.norm(errors, axis=2), np.abs(along), atol=1e-9)


def test_smooth_noise_has_its_length():
    """Correlation of many fields over the distance d is exp(-(d / length)^2 / 2)."""
    points = np.stack([np.arange(0, 25.0, 5), np.zeros(5), np.zeros(5)], 1)
    draws = rng(2)
    fields = np.array([smooth_noise(points, draws, 8.0) for _ in range(4000)])
    expected = np.exp(-((points[:, 0] / 8) ** 2) / 2)
    assert np.allclose(np.corrcoef(fields.T)[0], expected, atol=0.06)
    assert np.allclose(fields.std(0), 1, atol=0.05)


def test_rim_and_blind_parts_are_lost_but_not_the_lips():
    points, faces = dome(81, mouth=True)
    result = scan(points, faces, rng(), **OFF | {"coverage": 0.3})
    border = points[outer_border(points, faces)]
    kept = points[result.vertex]
    assert np.linalg.norm(kept[:, None] - border, axis=2).min() >= RIM
    assert 0.3 * len(points) < len(kept) < 0.9 * len(points)
    lips = np.flatnonzero((np.abs(points[:, 0]) < 15) & (np.abs(points[:, 2] + 20) < 8))
    lips = np.intersect1d(lips, np.unique(faces))
    assert len(lips) > 20 and np.isin(lips, result.vertex).all()
    with pytest.raises(ValueError, match="no triangle faces the cameras"):
        scan(points * [1, -1, 1], faces[:, [0, 2, 1]], rng(), **OFF | {"coverage": 0.9})


def test_holes_take_skin_away():
    points, faces = dome(81)
    one, many = (scan(points, faces, rng(), **OFF | {"holes": count}) for count in (1, 20))
    assert len(faces) > len(one.faces) > len(many.faces) > 0.7 * len(faces)


def test_same_seed_same_scan_and_switches_do_not_disturb_each_other():
    points, faces = dome()
    one, two = (scan(points, faces, rng(4)) for _ in range(2))
    assert one.points.tobytes() == two.points.tobytes() and one.faces.tobytes() == two.faces.tobytes()
    whole, noisy = scan(points, faces, rng(4)), scan(points, faces, rng(4), frame=0.0)
    assert np.allclose(whole.frame.inverse(whole.points), noisy.points, atol=1e-9)
