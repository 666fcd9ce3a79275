"""What the page shows of a patient in 3D: skin, bones and scan, how far each method moves the skin, its error."""

import base64
import gzip
from collections.abc import Mapping

import numpy as np

from pinnochio.figures.patient import BONE, FARTHEST, SEGMENTS, SKIN, UNKNOWN
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

STEP = 0.05  # mm, of points, displacements and errors; the eye sees none of it
NOT_JUDGED = -(2**15)  # of an error, in steps


def judged_errors(patient: PatientModel, points: np.ndarray, target: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Signed distance (s,) mm of the moved skin points (s, 3) mm to the target, NaN off the face that is judged."""
    judged = patient.judged_points
    errors = np.full(len(points), np.nan)
    errors[judged] = signed_distances(points[judged], *target)
    return errors


def make_view(
    patients: Mapping[str, PatientModel],
    plan: Plan,
    target: tuple[np.ndarray, np.ndarray],
    moved: Mapping[str, np.ndarray],
    errors: Mapping[str, np.ndarray],
) -> dict:
    """Surfaces and, by method, motion and error of the skin, as JSON holds them.

    patients: by method the model that it predicts on, whose skins may differ around the mouth; target: points (k, 3) mm
    and faces of the scan; moved, errors: points (s, 3) mm of the predicted skin and their judged_errors, by method.
    Points, displacements and errors are int16 in units of `step` mm, -32768 for NaN, faces int32; each as of encode.
    """
    models = {id(patient): patient for patient in patients.values()}
    patient, number = next(iter(models.values())), {key: index for index, key in enumerate(models)}
    segments = [SEGMENTS[index % len(SEGMENTS)] for index in range(len(patient.segments))]
    return {
        "step": STEP,
        "farthest": FARTHEST,
        "colours": {"skin": SKIN, "unknown": UNKNOWN, "bones": [BONE, *segments]},
        "skins": [
            _surface(model.skin_points, model.skin_faces)
            | {"error": _steps(judged_errors(model, model.skin_points, target))}
            for model in models.values()
        ],
        "bone": _surface(patient.bone_points, patient.bone_faces)
        | {"segment": (patient.bone_segment + 1).tolist(), "moved": _steps(patient.bone_displacement(plan))},
        "scan": _surface(*target),
        "methods": {
            method: {
                "skin": number[id(patients[method])],
                "moved": _steps(points - patients[method].skin_points),
                "error": _steps(errors[method]),
            }
            for method, points in moved.items()
        },
    }


def _surface(points: np.ndarray, faces: np.ndarray) -> dict[str, str]:
    return {"points": encode(np.rint(points / STEP), "<i2"), "faces": encode(faces, "<i4")}


def _steps(values: np.ndarray) -> str:
    steps = np.clip(np.rint(values / STEP), NOT_JUDGED + 1, -NOT_JUDGED - 1)
    return encode(np.where(np.isnan(steps), NOT_JUDGED, steps), "<i2")


def encode(values: np.ndarray, kind: str) -> str:
    """Whole numbers (n,) or (n, k) as the page carries them: each row less the one before, column by column, the low
    bytes of all numbers before the high ones, gzip, base64. Neighbours are alike, so this is a third of the bytes."""
    rows = np.asarray(values).reshape(len(values), -1).astype(kind)
    steps = rows - np.vstack([np.zeros_like(rows[:1]), rows[:-1]])  # wraps around, and back
    planes = np.ascontiguousarray(steps.T).view(np.uint8).reshape(-1, rows.dtype.itemsize).T
    return base64.b64encode(gzip.compress(planes.tobytes(), 9, mtime=0)).decode()
