"""Makes the files of a new patient's prediction for 3D Slicer and ParaView."""

from collections.abc import Sequence
from pathlib import Path

from pinnochio.model.labels import segment_name
from pinnochio.patients.exports import write_mesh, write_skin, write_surface
from pinnochio.patients.result import read_patient, read_result
from pinnochio.plans.plan import Plan


def export_prediction(
    case: str, model: str, plan: str, result: str, mesh: str, skin: Sequence[str], bones: str
) -> None:
    """Write the mesh (VTU), the skin in its formats (VTP, PLY, STL) and {bone}.stl into the folder bones, LPS mm."""
    patient, planned = read_patient(model), Plan.read(plan, case)
    prediction = read_result(result, case, patient)
    write_mesh(patient, prediction.displacement, mesh)
    write_skin(
        patient=patient,
        displacement=prediction.displacement,
        half_width=prediction.half_width,
        **{Path(path).suffix[1:]: path for path in skin},
    )
    Path(bones).mkdir(exist_ok=True)
    moved = patient.bone_points + patient.bone_displacement(planned)
    owner = patient.bone_segment[patient.bone_faces[:, 0]]
    for index in range(-1, len(patient.segments)):
        name = segment_name(index, patient.segments)
        write_surface(moved, patient.bone_faces[owner == index], Path(bones, f"{name}.stl"))
