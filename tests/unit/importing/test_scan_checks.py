"""Scans of very many triangles are thinned within what is said, and surfaces of fine volumes stay where they are."""

import logging
import re

import numpy as np
import pytest
import pyvista as pv
from scipy.spatial import cKDTree

from pinnochio.errors import InputError
from pinnochio.importing import scan_checks
from pinnochio.importing.scan_checks import thinned, without_spikes
from pinnochio.model.labels import CRANIUM, SUPERFICIAL
from pinnochio.model.surfaces import bone_surface, skin_surface


def wavy(count: int) -> tuple[np.ndarray, np.ndarray]:
    plane = pv.Plane(i_size=150, j_size=150, i_resolution=count, j_resolution=count).triangulate()
    points = np.asarray(plane.points, float)
    points[:, 2] = 8 * np.sin(points[:, 0] / 15) * np.cos(points[:, 1] / 20)
    return points, plane.regular_faces.astype(np.int32)


def test_a_scan_of_many_triangles_is_thinned_and_its_error_is_said(monkeypatch, caplog):
    monkeypatch.setattr(scan_checks, "MANY", 60_000)
    points, faces = wavy(400)
    with caplog.at_level(logging.WARNING):
        fewer, triangles = thinned(points, faces, "P1", "scan.ply")
    said = re.search(r"320000 triangles are thinned to (\d+); .* lie ([\d.]+) mm off at 95 %", caplog.text)
    assert len(triangles) == int(said[1]) < 60_000 and triangles.max() < len(fewer)
    height = 8 * np.sin(fewer[:, 0] / 15) * np.cos(fewer[:, 1] / 20)
    assert np.percentile(np.abs(height - fewer[:, 2]), 95) < 0.1 and float(said[2]) < 0.1
    assert cKDTree(fewer).query(points)[0].max() < 3  # no hole


def test_a_thinning_that_takes_detail_away_is_refused(monkeypatch):
    monkeypatch.setattr(scan_checks, "MANY", 200)
    with pytest.raises(InputError, match="lie .* mm off at 95 %"):
        thinned(*wavy(100), "P1", "scan.ply")


def test_a_spike_goes_and_what_is_around_it_stays():
    points, faces = wavy(60)
    spiked = points.copy()
    spiked[[1800, 1801]] += [[0, 0, 400.0], [0, 10, 380.0]]
    left, triangles = without_spikes(spiked, faces, "P1", "scan.ply")
    assert len(points) - len(left) == 2 and np.abs(left[:, 2]).max() < 9
    assert len(faces) - 13 < len(triangles) < len(faces)
    assert np.array_equal(without_spikes(points, faces, "P1", "scan.ply")[0], points)


def test_a_fine_volume_gives_the_surfaces_of_a_coarse_one():
    surfaces = []
    for spacing in (0.4, 1.2):
        axis = np.arange(-39.6 + spacing / 2, 39.6, spacing)
        distance = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)
        labels = np.where(distance < 20, CRANIUM, np.where(distance < 33, SUPERFICIAL, 0)).astype(np.uint8)
        grid = np.full(3, spacing), np.full(3, axis[0])
        surfaces.append((bone_surface(labels, *grid, ()).points, skin_surface(labels, *grid)[0]))
    for fine, coarse in zip(*surfaces, strict=True):
        radii = [np.linalg.norm(points, axis=1) for points in (fine, coarse)]
        assert abs(radii[0].mean() - radii[1].mean()) < 0.05 and np.ptp(radii[0]) < 0.4
        assert np.abs(fine.mean(axis=0)).max() < 0.1
