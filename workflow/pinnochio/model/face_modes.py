"""Smooth symmetric patterns of the face that correspond between patients, the broadest first."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from pinnochio.geometry.scattered import farthest
from pinnochio.model.correspondence import ACROSS, by_landmarks, marks, mirrored_marks
from pinnochio.model.patient import PatientModel

COUNT = 80  # patterns: more say no more of 32 patients [X]
POINTS, WIDTH = 700, 7.0  # of half a face; mm over which the patterns are smooth at least [X]
MIDLINE = 1.0  # mm from it on which no point stands


@dataclass(frozen=True)
class FaceModes:
    """Patterns on a symmetric template: landmarks (l, 3) mm, points (h, 3) mm of its right half.

    The patterns are the lowest modes of the graph that a Gaussian kernel makes of the points and their mirror images;
    even (h, 80): by how much each point carries each of them. They are kept, because another machine might turn modes
    that lie close together.
    """

    landmarks: np.ndarray
    points: np.ndarray
    even: np.ndarray

    @classmethod
    def of(cls, models: Sequence[PatientModel]) -> "FaceModes":
        """Of some patients: their mean landmarks, and the first one's face."""
        known = [marks(model) for model in models]
        both = [each - each.mean(axis=0) for one in known for each in (one, mirrored_marks(one))]
        landmarks = np.mean(both, axis=0)
        face = by_landmarks(_face(models[0]), known[0], landmarks)
        half = np.where(face[:, :1] < 0, face, face * ACROSS)
        half = half[half[:, 0] < -MIDLINE]
        points = half[farthest(half, POINTS)]
        return cls(landmarks, points, _lowest(near(points, points)))

    def __call__(self, model: PatientModel) -> np.ndarray:
        """The patterns (k, q) at the points of a patient's judged face, mean square 1 over the template."""
        places = by_landmarks(_face(model), marks(model), self.landmarks)
        kernel = near(places, self.points)
        return kernel @ self.even / np.maximum(kernel.sum(axis=1, keepdims=True), 1e-9)


def near(places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Gaussian kernel (k, h) of places (k, 3) and points (h, 3) mm with their mirror images."""
    here, there = (np.exp(-0.5 * cdist(places, each, "sqeuclidean") / WIDTH**2) for each in (points, points * ACROSS))
    return here + there


def _lowest(kernel: np.ndarray) -> np.ndarray:
    """The broadest patterns (h, q) of a kernel (h, h), divided by what the kernel's smoothing leaves of them, so that
    they are shown as they are."""
    degree = np.sqrt(kernel.sum(axis=1))
    values, vectors = np.linalg.eigh(kernel / np.outer(degree, degree))
    pattern = vectors[:, ::-1][:, :COUNT] / degree[:, None]
    pattern *= np.where(pattern.sum(axis=0) < 0, -1.0, 1.0) / np.sqrt(np.mean(pattern**2, axis=0))
    return pattern / values[::-1][:COUNT]


def _face(model: PatientModel) -> np.ndarray:
    return model.skin_points[model.judged_points]
