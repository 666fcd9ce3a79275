"""What the page shows of a patient in 3D: skin, bones and scan, how far each method moves the skin, its error."""

import base64
from collections.abc import Mapping

import numpy as np

from pinnochio.figures.patient import BONE, FARTHEST, SEGMENTS, SKIN, UNKNOWN
from pinnochio.geometry.closest_points import signed_distances
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan

STEP = 0.01  # mm, of displacements and errors
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
    Points are written as little-endian float32 in mm, faces as int32, displacements and errors as int16 in units of
    `step` mm, -32768 for NaN.
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
    return {"points": _encode(points, "<f4"), "faces": _encode(faces, "<i4")}


def _steps(values: np.ndarray) -> str:
    steps = np.clip(np.rint(values / STEP), NOT_JUDGED + 1, -NOT_JUDGED - 1)
    return _encode(np.where(np.isnan(steps), NOT_JUDGED, steps), "<i2")


def _encode(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind)).decode()
