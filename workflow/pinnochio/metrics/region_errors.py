"""Errors of a predicted skin where a surgeon looks: regions of the face and its landmarks."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES

NECK = "neck"
REGIONS = tuple(name for name in NAMES if name not in ("other", NECK))
SHOWN = (*REGIONS, NECK)  # the neck counts in no measure of the whole face
MIDLINE = ("pronasale", "subnasale", "labrale_superius", "labrale_inferius", "sublabiale", "pogonion", "menton")
LANDMARKS = (*MIDLINE, "cheilion_right", "cheilion_left")


def region_errors(region, outside) -> dict[str, float]:
    """Mean unsigned (region_*) and signed (bias_*) distance in mm of every region of SHOWN; NaN where it has none.

    region (k,): of each sample of the target, an index into NAMES; outside (k,) mm: its signed distance,
    positive where the prediction lies outside the target.
    """
    errors = {}
    for name in SHOWN:
        part = outside[region == NAMES.index(name)]
        errors[f"region_{name}"] = float(np.abs(part).mean()) if len(part) else np.nan
        errors[f"bias_{name}"] = float(part.mean()) if len(part) else np.nan
    return errors


def landmark_points(patient: PatientModel) -> dict[str, int]:
    """The skin point nearest to each of LANDMARKS before surgery; InputError where the face cannot be read."""
    marks = face_landmarks(patient)
    places = np.vstack([*(getattr(marks, name) for name in MIDLINE), marks.cheilion])
    used = np.unique(patient.skin_faces)
    nearest = used[cKDTree(patient.skin_points[used]).query(places)[1]]
    return dict(zip(LANDMARKS, nearest, strict=True))
