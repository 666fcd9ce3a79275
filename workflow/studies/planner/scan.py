"""The post-operative scan of a patient, where its folder holds one, in the patient's own frame."""

from pathlib import Path

import numpy as np

from pinnochio.errors import InputError
from pinnochio.importing.registration import register
from pinnochio.importing.segmentation import read_postop
from pinnochio.model.bones import nasion_height
from pinnochio.model.patient import PatientModel
from pinnochio.model.surfaces import BoneSurface

NAMES = ("postop.ply", "postop.stl", "postop.obj", "postop.vtp")
NASION_ABOVE = 20.0  # mm from the top of the maxilla's segment to skin that no operation moves [I]
LIMIT = 2.0  # mm of median residual above which the scan does not fit [I]


def read_scan(patient: PatientModel, case: str, home: str | Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Points (k, 3) mm and faces of the scan in the folder, registered on the skin that surgery does not move.

    None where there is none; InputError for several, and for one that is no scan of this face.
    """
    files = [Path(home) / name for name in NAMES if (Path(home) / name).is_file()]
    if not files:
        return None
    if len(files) > 1:
        raise InputError(case, home, f"it holds {', '.join(file.name for file in files)}", "keep one scan")
    skin, faces = patient.skin_points, patient.skin_faces
    points, triangles = read_postop(files[0], case, skin)
    plane = nasion_height(patient.bone_points, patient.bone_segment, patient.segments, NASION_ABOVE)
    bones = patient.bone_points, patient.bone_normals, patient.bone_faces, patient.bone_segment, patient.segments
    by = {"case": case, "file": files[0], "limit": LIMIT, "bone": BoneSurface(*bones)}
    fit = register(points, triangles, skin, faces, plane, **by)
    return fit.motion.apply(points), triangles
