"""The post-operative scan of a patient, where its folder holds one, in the patient's own frame."""

from pathlib import Path

import numpy as np

from pinnochio.errors import InputError
from pinnochio.importing.postop_skin import registered_skin
from pinnochio.study.patients import SCANS
from studies.planner.prepared import Prepared


def read_scan(prepared: Prepared) -> tuple[np.ndarray, np.ndarray] | None:
    """Points (k, 3) mm and faces of the scan in the patient's folder, registered and checked as those of a study.

    None where there is none; InputError for several, and for one that is no scan of this face.
    """
    case, home = prepared.case, Path(prepared.home)
    files = [path for path in sorted(home.iterdir()) if path.name.lower() in SCANS]
    if not files:
        return None
    if len(files) > 1:
        raise InputError(case, home, f"it holds {', '.join(file.name for file in files)}", "keep one scan")
    fit, points, faces = registered_skin(files[0], case, prepared.skin, prepared.bone, **prepared.scan)
    return fit.motion.apply(points), faces
