"""The files for 3D Slicer and ParaView, read back as each of the two reads them."""

import numpy as np
import pytest
import pyvista as pv
import trimesh
from scipy.spatial import cKDTree
from vtkmodules.vtkIOGeometry import vtkSTLReader
from vtkmodules.vtkIOPLY import vtkPLYReader

from pinnochio.geometry.closed_surfaces import read_closed_surface
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.patients.exports import write_mesh, write_skin, write_surface
from tests.helpers.patients import tiny_patient

TO_RAS = np.array([-1.0, -1.0, 1.0])


def as_in_slicer(path):
    """Points (p, 3) in Slicer's world, RAS, as its model reader finds them; and the vectors it shows.

    vtkMRMLModelStorageNode: SPACE=LPS or SPACE=RAS in a comment of PLY or the header of STL, or as field data.
    """
    if path.suffix in (".ply", ".stl"):
        reader = vtkPLYReader() if path.suffix == ".ply" else vtkSTLReader()
        reader.SetFileName(str(path))
        reader.Update()
        if path.suffix == ".ply":
            comments = reader.GetComments()
            said = "\n".join(comments.GetValue(i) for i in range(comments.GetNumberOfValues()))
        else:
            said = reader.GetHeader()
        mesh, space = pv.wrap(reader.GetOutput()), said[said.index("SPACE=") + 6 :][:3]
    else:
        mesh = pv.read(path)
        space = str(mesh.field_data["SPACE"][0])
    assert space == "LPS"
    vectors = mesh.active_vectors
    return mesh.points * TO_RAS, None if vectors is None else vectors * TO_RAS


@pytest.fixture
def patient():
    return tiny_patient()


def field(patient):
    rng = np.random.default_rng(1)
    return rng.uniform(-0.3, 0.3, patient.points.shape) + [1, -4, 2]


@pytest.mark.parametrize("name", ["skin.ply", "skin.stl"])
def test_a_surface_is_lps_and_says_so(patient, tmp_path, name):
    write_surface(patient.points, patient.skin_faces, tmp_path / name)
    corners = patient.points[patient.skin_faces]
    slicer, _ = as_in_slicer(tmp_path / name)
    assert cKDTree(slicer).query(corners.reshape(-1, 3) * TO_RAS)[0].max() < 1e-3
    shown = trimesh.load(tmp_path / name, process=False).triangles  # as ParaView shows it: as it stands
    assert np.allclose(shown, corners, atol=1e-4)
    # Outward faces stay outward.
    assert np.allclose(np.cross(shown[:, 1] - shown[:, 0], shown[:, 2] - shown[:, 0])[:, 2] > 0, True)


def test_our_reader_takes_a_closed_surface_back_as_it_was(tmp_path):
    box = trimesh.creation.icosphere(subdivisions=1, radius=30)
    points = np.asarray(box.vertices) + [10, -80, 40]
    for name in ("bone.ply", "bone.stl"):
        write_surface(points, box.faces.astype(np.int32), tmp_path / name)
        corners, *_ = read_closed_surface(tmp_path / name, None, pytest.fail)
        assert np.allclose(corners.mean(axis=0), points.mean(axis=0), atol=1e-3) and len(corners) == len(points)


def test_the_mesh_is_deformed_and_holds_its_fields(patient, tmp_path):
    u, path = field(patient), tmp_path / "deformed.vtu"
    write_mesh(patient, u, path)
    mesh = pv.read(path)
    assert np.allclose(mesh.points, patient.points + u)
    assert np.array_equal(mesh.cells_dict[pv.CellType.TETRA], patient.cells)
    assert np.allclose(mesh["displacement"], u) and np.array_equal(mesh["node_type"], patient.node_type)
    assert np.allclose(mesh["jacobian"], jacobians(patient.points, patient.cells, u))
    assert np.array_equal(mesh["tissue"], patient.tissue)
    points, vectors = as_in_slicer(path)
    assert np.allclose(points, (patient.points + u) * TO_RAS) and np.allclose(vectors, u * TO_RAS)


def test_the_skin_carries_displacement_and_interval(patient, tmp_path):
    u, width = field(patient), np.where(np.arange(len(patient.points)) % 2, np.nan, 1.5)
    files = [tmp_path / f"skin.{kind}" for kind in ("vtp", "ply", "stl")]
    write_skin(patient, u, width, *files)
    skin = pv.read(files[0])
    assert np.allclose(skin.points, patient.moved_skin(u), atol=1e-5)
    assert np.allclose(skin["displacement"], patient.moved_skin(u) - patient.skin_points)
    assert np.array_equal(skin["half_width"], width, equal_nan=True)
    points, vectors = as_in_slicer(files[0])
    assert np.allclose(points, skin.points * TO_RAS) and np.allclose(vectors, skin["displacement"] * TO_RAS)
    again = tmp_path / "again"
    again.mkdir()
    write_skin(patient, u, width, *(again / file.name for file in files))
    assert all((again / file.name).read_bytes() == file.read_bytes() for file in files)
