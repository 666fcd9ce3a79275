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

    A thin-plate spline takes the template's landmarks to the patient's; then the nearest point of the skin counts.
    """
    # Smoothed a little, because on a coarse face two landmarks may fall together.
    carried = RBFInterpolator(landmarks, marks(model), smoothing=1.0, kernel="thin_plate_spline", degree=1)(template)
    face = model.judged_points
    return face[cKDTree(model.skin_points[face]).query(carried)[1]]


def marks(model: PatientModel) -> np.ndarray:
    """Landmarks (l, 3) mm of the face."""
    return np.vstack([np.atleast_2d(point) for point in vars(face_landmarks(model)).values()])


def mirrored_marks(landmarks: np.ndarray) -> np.ndarray:
    """Landmarks (l, 3) mm of the mirror image of a face, in the order of :func:`marks`: those in pairs change sides."""
    return sides_changed(landmarks * ACROSS)


def sides_changed(values: np.ndarray) -> np.ndarray:
    """Values (l, ...) of landmarks with left and right exchanged."""
    return values[[*range(len(values) - len(SIDES)), *SIDES]]
