"""Tetrahedral mesh: angles, volumes, boundary, files; moves that keep the shape of cells."""

import numpy as np
import pytest

from pinnochio.geometry.mesh_topology import adjacency
from pinnochio.meshing.mesh import TetMesh
from pinnochio.meshing.smoothing import acceptable, acceptable_move, neighbour_mean
from tests.helpers.heads import kuhn_cube

REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)


def test_regular_tetrahedron():
    cells = np.array([[0, 1, 2, 3]], np.int32)
    cells = cells if TetMesh(REGULAR, cells, np.ones(1)).volumes()[0] > 0 else cells[:, [0, 1, 3, 2]]
    mesh = TetMesh(REGULAR, cells, np.ones(1, np.int8))
    assert mesh.volumes() == pytest.approx([8 / 3])
    assert mesh.dihedral_angles() == pytest.approx(np.degrees(np.arccos(1 / 3)))


def test_boundary_of_a_cube_is_closed_and_outward():
    mesh = kuhn_cube(3)
    faces, owner = mesh.boundary_faces()
    assert len(faces) == 6 * 2 * 9
    a, b, c = np.moveaxis(mesh.points[faces], 1, 0)
    cross = np.cross(b - a, c - a)
    assert np.abs(cross.sum(axis=0)).max() < 1e-12
    outward = np.einsum("ij,ij->i", cross, (a + b + c) / 3 - mesh.points[mesh.cells[owner]].mean(axis=1))
    assert outward.min() > 0
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(1)
    first, _ = adjacency(mesh.cells)
    assert 2 * len(first) + len(faces) == 4 * len(mesh.cells)


def test_file_returns_the_same_mesh(tmp_path):
    mesh = kuhn_cube()
    mesh.write(tmp_path / "mesh.vtu")
    back = TetMesh.read(tmp_path / "mesh.vtu")
    for name in ("points", "cells", "tissue"):
        assert np.array_equal(getattr(back, name), getattr(mesh, name))
        assert getattr(back, name).dtype == getattr(mesh, name).dtype
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.vtu"]


def test_acceptable_move_keeps_every_cell_acceptable():
    mesh = kuhn_cube(4)
    rng = np.random.default_rng(3)
    target = mesh.points + rng.normal(0, 0.15, mesh.points.shape)
    assert not acceptable(target, mesh.cells, 15).all()
    moved = acceptable_move(mesh.points, target, mesh.cells, 15)
    assert acceptable(moved, mesh.cells, 15).all()
    done = np.linalg.norm(moved - mesh.points, axis=1) / np.linalg.norm(target - mesh.points, axis=1)
    assert set(np.round(done, 6)) <= {0, *(np.round(0.5**k, 6) for k in range(6))}
    assert done.mean() > 0.1


def test_acceptable_move_goes_all_the_way_where_it_may():
    mesh = kuhn_cube(3)
    target = mesh.points * [1.0, 1.1, 1.0] + 0.3
    assert np.allclose(acceptable_move(mesh.points, target, mesh.cells, 12), target, atol=1e-15)


def test_neighbour_mean_of_a_path():
    points = np.array([[0, 0, 0], [1, 0, 0], [4, 0, 0], [9, 9, 9]], float)
    mean = neighbour_mean(points, np.array([[0, 1], [1, 2], [2, 1]]))
    assert np.allclose(mean, [[1, 0, 0], [2, 0, 0], [1, 0, 0], [9, 9, 9]])
