"""Import of label maps, plans and scans: every orientation lands in one place, every fault is named."""

import numpy as np
import pytest
import pyvista as pv
import SimpleITK as sitk

from pinnochio.errors import InputError
from pinnochio.importing.segmentation import read_labels, read_postop, read_segmentation, write_segmentation

SEGMENTS = ("lefort1", "chin")
VALUES = {"superficial": 3, "muscle": 7, "cranium": 20, "lefort1": 21, "chin": 22}
SPACING, ORIGIN = np.array([4.0, 5.0, 6.0]), np.array([-30.0, 12.0, 100.0])


def user_volume():
    """A phantom without any symmetry, [ix, iy, iz], in the user's values."""
    volume = np.zeros((16, 18, 20), np.int16)
    volume[1:14, 2:17, 1:19] = 3
    volume[2:9, 4:12, 2:15] = 7
    volume[3:6, 10:15, 12:18] = 20
    volume[4:7, 5:8, 6:10] = 21
    volume[8:12, 3:5, 2:4] = 22
    return volume


def expected():
    volume = user_volume()
    out = np.zeros(volume.shape, np.uint8)
    for value, code in zip((3, 7, 20, 21, 22), (1, 2, 10, 11, 12), strict=True):
        out[volume == value] = code
    return out


def image(volume=None, spacing=SPACING):
    made = sitk.GetImageFromArray(np.ascontiguousarray((user_volume() if volume is None else volume).T))
    made.SetSpacing([float(s) for s in spacing])
    made.SetOrigin([float(o) for o in ORIGIN])
    return made


def stored(path, made):
    sitk.WriteImage(made, str(path))
    return path


def test_floats_that_hold_integers_pass_and_unknown_values_are_air_with_a_warning(tmp_path, caplog):
    volume = user_volume().astype(np.float32)
    volume[0, 0, 0], volume[0, 1, 0] = 99, 41
    head = read_segmentation(stored(tmp_path / "head.mha", image(volume)), "P1", VALUES, SEGMENTS)
    np.testing.assert_array_equal(head.labels, expected())
    assert "41, 99" in caplog.text and "P1" in caplog.text


def without(value):
    volume = user_volume()
    volume[volume == value] = 0
    return volume


@pytest.mark.parametrize("packed", [True, False])
def test_voxels_beside_their_header_are_read_with_it(tmp_path, packed):
    sitk.WriteImage(image(), str(tmp_path / "a.nhdr"), packed)
    labels = read_segmentation(tmp_path / "a.nhdr", "P1", VALUES, SEGMENTS).labels
    np.testing.assert_array_equal(labels, expected())
    (tmp_path / ("a.raw.gz" if packed else "a.raw")).unlink()
    with pytest.raises(InputError, match="the file with its voxels is not there"):
        read_segmentation(tmp_path / "a.nhdr", "P1", VALUES, SEGMENTS)


def test_what_a_bone_encloses_is_bone_but_for_air_on_purpose(tmp_path, caplog):
    volume = user_volume()
    volume[2:9, 4:13, 4:12] = 21  # solid, then with hollows: of air, of tissue, and of what is left out
    solid = (volume == 21).sum()
    for place, value in ((5, 0), (7, 3), (9, 9)):
        volume[4:6, place, 6:9] = value
    path = stored(tmp_path / "a.nii.gz", image(volume))
    labels = read_segmentation(path, "P1", VALUES | {"left_out": [9]}, SEGMENTS).labels
    assert (labels == 11).sum() == solid - 6 and "'lefort1' encloses are bone" in caplog.text
    assert not labels[4:6, 9, 6:9].any()


@pytest.mark.parametrize("values", [VALUES, {name: code for name, code in VALUES.items() if name != "muscle"}])
def test_a_head_without_muscle_comes_in_without_it(tmp_path, values, caplog):
    path = stored(tmp_path / "head.nrrd", image(without(7)))
    head = read_segmentation(path, "P1", values, SEGMENTS)
    assert not (head.labels == 2).any()
    np.testing.assert_array_equal(head.labels, np.where(expected() == 2, 0, expected()))
    assert ("nothing carries the label 7 of 'muscle'" in caplog.text) == ("muscle" in values)


def test_muscle_that_the_configuration_does_not_name_is_air_with_a_warning(tmp_path, caplog):
    values = {name: value for name, value in VALUES.items() if name != "muscle"}
    head = read_segmentation(stored(tmp_path / "head.nrrd", image()), "P1", values, SEGMENTS)
    assert not (head.labels[expected() == 2]).any() and "voxel values 7 are not named" in caplog.text


@pytest.mark.parametrize("suffix", ["nii.gz", "nrrd", "mha", "nii"])
def test_written_labels_come_back_voxel_by_voxel_and_byte_by_byte(tmp_path, suffix):
    first, second = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    for path in (first, second):
        write_segmentation(expected(), SPACING, ORIGIN, path)
    head = read_labels(first)
    np.testing.assert_array_equal(head.labels, expected())
    np.testing.assert_allclose(head.origin, ORIGIN)
    np.testing.assert_allclose(head.spacing, SPACING)
    assert first.read_bytes() == second.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == [first.name, second.name]


def face():
    mesh = pv.Sphere(radius=80, theta_resolution=20, phi_resolution=20)
    return np.asarray(mesh.points, float), mesh


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "vtp"])
def test_a_scan_is_read_with_shared_vertices(tmp_path, suffix):
    points, mesh = face()
    mesh.save(tmp_path / f"face.{suffix}")
    vertices, faces = read_postop(tmp_path / f"face.{suffix}", "P1", points)
    again = pv.PolyData.from_regular_faces(vertices, faces)
    assert len(vertices) == len(points) and len(faces) == mesh.n_cells
    assert again.n_open_edges == 0
    assert again.volume == pytest.approx(mesh.volume, rel=1e-5)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("scale", [1.0, 0.1, 0.001])
def test_an_stl_in_any_metric_unit_comes_in_as_millimetres_with_each_vertex_once(tmp_path, caplog, scale, binary):
    points, mesh = face()
    corners = mesh.regular_faces
    mesh = pv.PolyData.from_regular_faces(
        scale * points[corners].reshape(-1, 3), np.arange(corners.size).reshape(-1, 3)
    )
    assert mesh.n_points == 3 * mesh.n_cells
    mesh.save(tmp_path / "face.stl", binary=binary)
    assert (tmp_path / "face.stl").read_bytes().startswith(b"solid") != binary
    vertices, faces = read_postop(tmp_path / "face.stl", "P1", points)
    again = pv.PolyData.from_regular_faces(vertices, faces)
    assert len(vertices) == len(points) and again.n_open_edges == 0
    np.testing.assert_allclose(again.bounds, pv.PolyData(points).bounds, atol=1e-3)
    assert ("taken as" in caplog.text) == (scale != 1)
