"""Where a point of one face stands on another: carried by the landmarks of both."""

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from pinnochio.model.landmarks import face_landmarks
from pinnochio.model.patient import PatientModel

SIDES = (-3, -4, -1, -2)  # the last landmarks, wings of the nose and corners of the mouth, with their sides changed
ACROSS = np.array([-1.0, 1.0, 1.0])  # mirrors LPS coordinates left to right


def corresponding(template: np.ndarray, landmarks: np.ndarray, model: PatientModel) -> np.ndarray:
    """Skin point (t,) of the judged face that stands where each template point (t, 3) does.

    The landmarks carry the template to the patient; then the nearest point of the skin counts.
    """
    face = model.judged_points
    return face[cKDTree(model.skin_points[face]).query(by_landmarks(template, landmarks, marks(model)))[1]]


def by_landmarks(points: np.ndarray, landmarks: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Points (k, 3) mm of a face on another one: a thin-plate spline takes landmarks (l, 3) mm of the first to those
    of the other one."""
    # Smoothed a little, because on a coarse face two landmarks may fall together.
    return RBFInterpolator(landmarks, others, smoothing=1.0, kernel="thin_plate_spline", degree=1)(points)


def marks(model: PatientModel) -> np.ndarray:
    """Landmarks (l, 3) mm of the face."""
    return np.vstack([np.atleast_2d(point) for point in vars(face_landmarks(model)).values()])


def mirrored_marks(landmarks: np.ndarray) -> np.ndarray:
    """Landmarks (l, 3) mm of the mirror image of a face, in the order of :func:`marks`: those in pairs change sides."""
    return (landmarks * ACROSS)[[*range(len(landmarks) - len(SIDES)), *SIDES]]
