"""Surfaces of phantoms against closed forms."""

import numpy as np
import pytest
import pyvista as pv

from pinnochio.geometry.triangles import enclosed_volume, face_normals, vertex_normals
from pinnochio.model.surfaces import BoneSurface, bone_surface, contour, skin_surface

SEGMENTS = ("ball", "box", "absent")
SPACING, ORIGIN = np.array([1.0, 1.0, 1.5]), np.array([-40.0, 10.0, -30.0])
CENTRE, RADIUS = np.array([-15.0, 35.0, 0.0]), 16.0
LOW, HIGH = np.array([5.0, 20.0, -15.0]), np.array([29.0, 50.0, 12.0])


def grid(shape=(80, 60, 44)):
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1) * SPACING + ORIGIN


@pytest.fixture(scope="module")
def labels():
    where = grid()
    volume = np.ones(where.shape[:3], np.uint8)
    volume[np.linalg.norm(where - CENTRE, axis=-1) < RADIUS] = 11
    volume[((where > LOW) & (where < HIGH)).all(-1)] = 12
    volume[where[..., 2] > 25] = 10
    return volume


@pytest.fixture(scope="module")
def bone(labels):
    return bone_surface(labels, SPACING, ORIGIN, SEGMENTS)


def test_sphere_has_the_area_volume_normals_and_place_of_the_sphere(bone):
    ball = bone.part(0)
    radial = ball.points - CENTRE
    assert np.abs(np.linalg.norm(radial, axis=1) - RADIUS).max() < 0.7
    assert np.abs(np.linalg.norm(radial, axis=1).mean() - RADIUS) < 0.15
    assert enclosed_volume(ball.points, ball.faces) == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.03)
    assert face_normals(ball.points, ball.faces)[1].sum() == pytest.approx(4 * np.pi * RADIUS**2, rel=0.03)
    assert np.einsum("ij,ij->i", ball.normals, radial / np.linalg.norm(radial, axis=1)[:, None]).min() > 0.95
    np.testing.assert_allclose(np.linalg.norm(ball.normals, axis=1), 1)


def test_box_fills_its_voxels(labels, bone):
    box = bone.part(1)
    voxels = (labels == 12).sum() * SPACING.prod()
    assert enclosed_volume(box.points, box.faces) == pytest.approx(voxels, rel=0.02)
    low, high = box.points.min(0), box.points.max(0)
    centres = grid()[labels == 12]
    np.testing.assert_allclose(low, centres.min(0) - SPACING / 2, atol=0.35)
    np.testing.assert_allclose(high, centres.max(0) + SPACING / 2, atol=0.35)


def test_every_segment_is_closed_with_the_wanted_edges_and_absent_ones_are_absent(bone):
    assert set(np.unique(bone.segment)) == {-1, 0, 1}
    assert bone.faces.dtype == np.int32 and bone.segment.dtype == np.int8
    for index in (-1, 0, 1):
        part = bone.part(index)
        mesh = pv.PolyData.from_regular_faces(part.points, part.faces)
        assert mesh.n_open_edges == 0 and mesh.is_manifold
        lengths = mesh.extract_all_edges().compute_cell_sizes(length=True)["Length"]
        assert 2.0 < lengths.mean() < 3.2
    coarse = contour(np.ones((20, 20, 20)), (1, 1, 1), (0, 0, 0), 5.0)
    fine = contour(np.ones((20, 20, 20)), (1, 1, 1), (0, 0, 0), 2.0)
    assert len(fine[0]) > 3 * len(coarse[0])


def test_a_plate_of_one_voxel_survives():
    volume = np.zeros((30, 30, 30), np.uint8)
    volume[5:25, 5:25, 15] = 11
    plate = bone_surface(volume, (1, 1, 1), (0, 0, 0), ("plate",))
    assert face_normals(plate.points, plate.faces)[1].sum() > 0.75 * 2 * 400
    assert np.ptp(plate.points[:, 0]) > 17


def test_unlabelled_marrow_is_no_surface_but_a_tooth_socket_is():
    volume = np.zeros((40, 40, 40), np.uint8)
    volume[8:32, 8:32, 8:32] = 11
    solid = bone_surface(volume, (1, 1, 1), (0, 0, 0), ("s",))
    volume[16:24, 16:24, 16:24] = 0
    marrow = bone_surface(volume, (1, 1, 1), (0, 0, 0), ("s",))
    np.testing.assert_array_equal(marrow.points, solid.points)
    volume[16:24, 16:24, 16:24] = 2
    socket = bone_surface(volume, (1, 1, 1), (0, 0, 0), ("s",))
    assert enclosed_volume(socket.points, socket.faces) == pytest.approx(24**3 - 8**3, rel=0.03)


def test_the_same_labels_give_the_same_surface_and_a_file_holds_it(labels, bone, tmp_path):
    again = bone_surface(labels, SPACING, ORIGIN, SEGMENTS)
    bone.write(tmp_path / "bone.vtp")
    stored = BoneSurface.read(tmp_path / "bone.vtp")
    for name in ("points", "normals", "faces", "segment"):
        np.testing.assert_array_equal(getattr(again, name), getattr(bone, name))
        np.testing.assert_array_equal(getattr(stored, name), getattr(bone, name))
        assert getattr(stored, name).dtype == getattr(bone, name).dtype


def test_skin_is_a_ball_where_the_head_is_one():
    """Neither steps of voxels nor shrinkage: the radius is right to a twentieth of a millimetre, the normals to 2
    degrees."""
    away = np.stack(np.meshgrid(*[np.arange(-30, 31.0)] * 3, indexing="ij"), -1)
    for radius in (12.4, 26.3):
        points, faces = skin_surface(np.linalg.norm(away, axis=-1) < radius, (1, 1, 1), (-30, -30, -30))
        distance = np.linalg.norm(points, axis=1)
        assert distance.mean() == pytest.approx(radius, abs=0.08) and distance.std() < 0.08
        leaning = np.einsum("ij,ij->i", vertex_normals(points, faces), points) / distance
        assert np.degrees(np.arccos(np.clip(leaning, -1, 1))).mean() < 2
        assert enclosed_volume(points, faces) == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.03)


def test_a_slope_of_voxels_is_smooth_and_sealed_lips_in_it_are_one_skin():
    x, y, z = np.meshgrid(*[np.arange(60)] * 3, indexing="ij")
    head = (y > 15 + x // 8) & (y < 50) & (np.abs(x - 30) < 22) & (np.abs(z - 30) < 22)
    # One voxel wide, two on the right.
    slit = (y < 30) & (np.abs(x - 30) < 12) & ((z == 31) | (z == 30 + (x > 30)))
    (skin, faces), lips = (skin_surface(labels, (1, 1, 1), (0, 0, 0)) for labels in (head, head & ~slit))
    front = skin[(np.abs(skin[:, [0, 2]] - 30) < 15).all(axis=1) & (skin[:, 1] < 30)]
    height = (front[:, 1] - front[:, 0] / 8) / np.hypot(1, 1 / 8)
    assert len(front) > 100 and np.abs(height - height.mean()).max() < 0.15  # of steps of 1 mm
    np.testing.assert_array_equal(lips[0], skin)
    np.testing.assert_array_equal(lips[1], faces)


def test_skin_is_open_where_the_head_is_cut_and_without_loose_pieces():
    where = grid()
    volume = (np.linalg.norm(where[..., :2] - CENTRE[:2], axis=-1) < 20).astype(np.uint8)
    volume[70:74, 50:54, 20:24] = 1  # a loose piece
    points, faces = skin_surface(volume, SPACING, ORIGIN)
    radius = np.linalg.norm(points[:, :2] - CENTRE[:2], axis=1)
    assert np.abs(radius - 20).max() < 0.9
    height = SPACING[2] * volume.shape[2]
    for border in (ORIGIN[2] - SPACING[2] / 2, ORIGIN[2] + height - SPACING[2] / 2):
        assert (np.abs(points[:, 2] - border) < 1e-5).sum() > 20  # a clean line
    assert face_normals(points, faces)[1].sum() == pytest.approx(2 * np.pi * 20 * height, rel=0.1)
    assert len(np.unique(faces)) == len(points)
    outward = np.einsum("ij,ij->i", face_normals(points, faces)[0], points[faces].mean(1) - [*CENTRE[:2], 0])
    assert (outward > 0).all()
    assert len(skin_surface(np.zeros((5, 5, 5), np.uint8), SPACING, ORIGIN)[0]) == 0
