"""Errors of a predicted skin where a surgeon looks: regions of the face and its landmarks."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.geometry.closest_points import signed_distances
from pinnochio.metrics.surface import Sampled
from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.patient import PatientModel
from pinnochio.model.regions import NAMES, regions

REGIONS = tuple(name for name in NAMES if name != "other")
MIDLINE = (
    "pronasale",
    "subnasale",
    "labrale_superius",
    "labrale_inferius",
    "sublabiale",
    "pogonion",
    "menton",
)
LANDMARKS = (*MIDLINE, "cheilion_right", "cheilion_left")


def region_errors(patient: PatientModel, moved, sampled: Sampled) -> dict[str, float]:
    """Mean unsigned (region_*) and signed (bias_*) distance in mm of every region of REGIONS; NaN where it has none.

    moved (s, 3) mm: the predicted skin; sampled: the samples of the target that the accuracy takes. Each belongs to the
    region of the skin point nearest to its closest point on the prediction. Signed: positive where the prediction lies
    outside the target. Raises InputError where the face cannot be read.
    """
    codes, faces = regions(patient), patient.skin_faces
    closest, kept = sampled.closest, sampled.judged
    queries, near = sampled.queries[kept], closest.points[kept]
    corners = faces[closest.face[kept]]
    nearest = np.linalg.norm(moved[corners] - near[:, None], axis=2).argmin(axis=1)
    region = codes[corners[np.arange(len(corners)), nearest]]
    outside = -signed_distances(queries, moved, faces)
    errors = {}
    for name in REGIONS:
        own = outside[region == NAMES.index(name)]
        errors[f"region_{name}"] = float(np.abs(own).mean()) if len(own) else np.nan
        errors[f"bias_{name}"] = float(own.mean()) if len(own) else np.nan
    return errors


def landmark_errors(patient: PatientModel, errors) -> dict[str, float]:
    """Columns landmark_*: the errors (s,) mm of the skin points at the point nearest to each landmark before surgery.

    Raises InputError where the face cannot be read.
    """
    marks = face_landmarks(patient)
    places = np.vstack([*(getattr(marks, name) for name in MIDLINE), marks.cheilion])
    used = np.unique(patient.skin_faces)
    nearest = used[cKDTree(patient.skin_points[used]).query(places)[1]]
    return {f"landmark_{name}": float(errors[point]) for name, point in zip(LANDMARKS, nearest, strict=True)}
