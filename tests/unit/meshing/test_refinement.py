"""Bisection: conforming, volumes kept, edges as short as wanted there alone, angles bounded, slits open."""

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import EDGES, FACES, boundary_faces
from pinnochio.meshing.mesh import TetMesh
from pinnochio.meshing.refinement import refine
from pinnochio.meshing.tetrahedralize import tetrahedralize
from tests.helpers.heads import ORIGIN, block_face, kuhn_cube

MOUTH = ORIGIN + [28, 12, 34]


def near(points, centre=MOUTH, reach=10.0):
    return np.linalg.norm(points - centre, axis=1) < reach


def around_the_mouth(points):
    return np.where(near(points), 3.0, np.inf)


@pytest.fixture(scope="module")
def face():
    return tetrahedralize(block_face()[0], np.ones(3), ORIGIN, 1200)


@pytest.fixture(scope="module")
def fine(face):
    return refine(face, around_the_mouth)


def edges_of(mesh):
    """Length and middle of all six edges of every cell."""
    one, two = np.moveaxis(mesh.points[mesh.cells[:, EDGES]], 2, 0)
    return np.linalg.norm(one - two, axis=2), (one + two) / 2


def facets(mesh):
    """Sides per face, and whether any node lies inside an edge of a cell (the mesh would not conform)."""
    sides = np.sort(mesh.cells[:, FACES].reshape(-1, 3), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


def area(mesh):
    a, b, c = np.moveaxis(mesh.points[mesh.boundary_faces()[0]], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.mark.parametrize("wanted", [0.3, 0.21])
def test_a_cube_stays_a_cube(wanted):
    mesh = kuhn_cube(2)
    mesh = TetMesh(mesh.points, mesh.cells, (mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(np.int8) + 1)
    fine = refine(mesh, lambda points: np.where(points[:, 2] < 0.4, wanted, 10.0))
    length, middle = edges_of(fine)
    assert (length[middle[..., 2] < 0.4] <= wanted).all()
    assert set(facets(fine)) == {1, 2}
    # A hanging node would leave a slit: faces with one cell inside the cube.
    assert area(fine) == pytest.approx(6, rel=1e-12)
    corners = fine.points[boundary_faces(fine.cells)[0]]
    assert np.any((corners == corners[:, :1]).all(axis=1) & np.isin(corners[:, 0], (0, 1)), axis=1).all()
    assert fine.volumes().min() > 0 and fine.volumes().sum() == pytest.approx(1, rel=1e-12)
    for code in (1, 2):
        assert fine.volumes()[fine.tissue == code].sum() == pytest.approx(0.5, rel=1e-12)
    # Kuhn's tetrahedra are halved into three shapes, the worst of them as flat as the first.
    assert fine.dihedral_angles().min() > mesh.dihedral_angles().min() - 10 > 30


def test_a_face_is_refined_around_the_mouth_alone(face, fine):
    length, middle = edges_of(fine)
    wished = near(middle.reshape(-1, 3)).reshape(length.shape)
    assert length[wished].max() <= 3.0 < edges_of(face)[0][near(edges_of(face)[1].reshape(-1, 3)).reshape(-1, 6)].max()
    assert len(fine.points) > 1.3 * len(face.points)
    new = fine.points[len(face.points) :]
    assert near(new, reach=10 + 2 * edges_of(face)[0].max()).all()
    assert np.array_equal(fine.points[: len(face.points)], face.points)
    untouched = ~near(face.points[face.cells].mean(axis=1), reach=10 + 3 * edges_of(face)[0].max())
    old = {tuple(cell) for cell in face.cells[untouched]}
    assert untouched.sum() > 50 and old <= {tuple(cell) for cell in fine.cells}


def test_a_face_stays_conforming_and_keeps_its_tissues_and_shape(face, fine):
    assert set(facets(fine)) == {1, 2}
    assert fine.volumes().min() > 0 and area(fine) == pytest.approx(area(face), rel=1e-12)
    for code in np.unique(face.tissue):
        kept = [mesh.volumes()[mesh.tissue == code].sum() for mesh in (face, fine)]
        assert kept[1] == pytest.approx(kept[0], rel=1e-12)
    assert fine.dihedral_angles().min() > 0.45 * face.dihedral_angles().min()
    low, high = ORIGIN - 0.5, ORIGIN - 0.5 + block_face()[0].shape
    for mesh in (face, fine):
        corners = mesh.points[mesh.boundary_faces()[0]]
        flat = ((corners == low) | (corners == high)).all(axis=1).any(axis=1)
        assert flat.sum() > 50


def test_the_slit_stays_open(face, fine):
    """Its two sides lie one on the other and share no node: as many places are there twice as triangles need."""
    for mesh in (face, fine):
        faces, _ = mesh.boundary_faces()
        middle, place = mesh.points[faces].mean(axis=1), mesh.points[faces].mean(axis=1) - ORIGIN
        inner = (
            (np.abs(place[:, 2] - 34) < 1.5) & (np.abs(place[:, 0] - 28) < 8) & (place[:, 1] > 9) & (place[:, 1] < 15)
        )
        normal = np.cross(*(mesh.points[faces[:, k]] - mesh.points[faces[:, 0]] for k in (1, 2)))[:, 2]
        above, below = inner & (normal < 0), inner & (normal > 0)
        assert above.sum() > 2 and below.sum() > 2, len(middle)
        assert not np.intersect1d(faces[above], faces[below]).size
    assert (inner & (normal < 0)).sum() > 4


def test_no_regions_leave_the_mesh_alone_and_give_the_same_bytes(face, fine):
    for name in ("points", "cells", "tissue"):
        same = getattr(refine(face, lambda points: np.full(len(points), np.inf)), name)
        assert same.tobytes() == getattr(face, name).tobytes()
        assert getattr(refine(face, around_the_mouth), name).tobytes() == getattr(fine, name).tobytes()
        assert getattr(fine, name).dtype == getattr(face, name).dtype


def test_impossible_sizes_are_refused():
    for wanted in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="wanted edge"):
            refine(kuhn_cube(1), lambda points, wanted=wanted: np.full(len(points), wanted))
