"""Files of a prediction for 3D Slicer and ParaView, in the patient's own frame: LPS, millimetres.

Every file says so where 3D Slicer looks for it: a comment of PLY, the header of STL, the field data of VTP and VTU
(`SPACE=LPS`). Slicer turns such a file into its own RAS; ParaView shows the numbers as they stand. A Slicer before 4.11
knows no such mark and takes any surface for RAS: there the model has to be turned by diag(-1, -1, 1)
[S: vtkMRMLModelStorageNode.cxx of Slicer].
"""

import os

import numpy as np
import pyvista as pv
from vtkmodules.vtkIOGeometry import vtkSTLWriter
from vtkmodules.vtkIOPLY import vtkPLYWriter

from pinnochio.files import replacing
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.mechanics.held_lips import CLOSING, shown_skin
from pinnochio.model.patient import PatientModel

SPACE = "SPACE=LPS"
ABOUT = "soft-tissue prediction, research only, mm"


def write_mesh(patient: PatientModel, displacement: np.ndarray, path: str | os.PathLike) -> None:
    """Write the deformed tetrahedra as VTU, with displacement (n, 3) mm and node type, tissue and J of each element."""
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: patient.cells}, patient.points + displacement)
    grid.point_data["node_type"] = patient.node_type
    grid.cell_data["tissue"] = patient.tissue
    grid.cell_data["jacobian"] = jacobians(patient.points, patient.cells, displacement)
    _save(grid, displacement, path)


def write_skin(
    patient: PatientModel,
    displacement: np.ndarray,
    half_width: np.ndarray,
    vtp: str | os.PathLike,
    ply: str | os.PathLike,
    stl: str | os.PathLike,
) -> None:
    """Write the predicted skin, its lips held, as VTP, PLY and STL; VTP has displacement (s, 3), half_width (s,) mm."""
    moved = shown_skin(patient, displacement, CLOSING)
    skin = pv.PolyData.from_regular_faces(moved, patient.skin_faces)
    skin.point_data["half_width"] = half_width
    _save(skin, moved - patient.skin_points, vtp)
    write_surface(moved, patient.skin_faces, ply)
    write_surface(moved, patient.skin_faces, stl)


def write_surface(points: np.ndarray, faces: np.ndarray, path: str | os.PathLike) -> None:
    """Write points (p, 3) mm LPS and faces (f, 3) as binary PLY or STL with the mark of their frame."""
    writer = vtkPLYWriter() if str(path).endswith(".ply") else vtkSTLWriter()
    if isinstance(writer, vtkPLYWriter):
        writer.AddComment(ABOUT)
        writer.AddComment(SPACE)
    else:
        writer.SetHeader(f"{ABOUT} {SPACE}")
    writer.SetInputData(pv.PolyData.from_regular_faces(np.asarray(points, float), faces))
    writer.SetFileTypeToBinary()
    with replacing(path) as temporary:
        writer.SetFileName(str(temporary))
        writer.Write()


def _save(data: pv.DataSet, displacement: np.ndarray, path: str | os.PathLike) -> None:
    """Save with the displacement as the vectors that a change of frame turns too."""
    data.point_data["displacement"] = displacement
    data.set_active_vectors("displacement")
    data.field_data["SPACE"] = ["LPS"]
    with replacing(path) as temporary:
        data.save(temporary)
