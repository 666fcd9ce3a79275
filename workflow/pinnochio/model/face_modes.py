"""Smooth patterns of the face that correspond between patients, symmetric and antisymmetric, the broadest first."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from pinnochio.geometry.scattered import farthest
from pinnochio.model.correspondence import ACROSS, by_landmarks, marks, mirrored_marks
from pinnochio.model.patient import PatientModel

COUNTS = {1.0: 80, -1.0: 20}  # symmetric and antisymmetric patterns: more say no more of 32 patients [X]
POINTS, WIDTH = 700, 7.0  # of half a face; mm over which the patterns are smooth at least [X]
MIDLINE = 1.0  # mm from it on which no point stands


@dataclass(frozen=True)
class FaceModes:
    """Patterns on a symmetric template: landmarks (l, 3) mm, points (h, 3) mm of its right half.

    The patterns are the lowest modes of the graph that a Gaussian kernel makes of the points and their mirror images;
    even (h, 80) and odd (h, 20): by how much each point carries each of them. They are kept, because another machine
    might turn modes that lie close together.
    """

    landmarks: np.ndarray
    points: np.ndarray
    even: np.ndarray
    odd: np.ndarray

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
        here, there = near(points, points), near(points, points * ACROSS)
        even, odd = (_lowest(here + sign * there, here + there, count) for sign, count in COUNTS.items())
        return cls(landmarks, points, even, odd)

    def __call__(self, model: PatientModel) -> np.ndarray:
        """The patterns (k, q) at the points of a patient's judged face, mean square 1 over the template."""
        places = by_landmarks(_face(model), marks(model), self.landmarks)
        here, there = near(places, self.points), near(places, self.points * ACROSS)
        shown = np.hstack([(here + there) @ self.even, (here - there) @ self.odd])
        return shown / np.maximum((here + there).sum(axis=1, keepdims=True), 1e-9)

    def halves(self, patterns: np.ndarray) -> list[np.ndarray]:
        """Of patterns (k, q) the symmetric ones, which come first, and the antisymmetric ones."""
        return np.split(patterns, [self.even.shape[1]], axis=1)


def near(places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Gaussian kernel (k, h) of places (k, 3) and points (h, 3) mm."""
    return np.exp(-0.5 * cdist(places, points, "sqeuclidean") / WIDTH**2)


def _lowest(kernel: np.ndarray, whole: np.ndarray, count: int) -> np.ndarray:
    """The broadest patterns (h, q) of a kernel (h, h) over the degrees of the whole one, divided by what the kernel's
    smoothing leaves of them, so that they are shown as they are."""
    degree = np.sqrt(whole.sum(axis=1))
    values, vectors = np.linalg.eigh(kernel / np.outer(degree, degree))
    pattern = vectors[:, ::-1][:, :count] / degree[:, None]
    pattern *= np.where(pattern.sum(axis=0) < 0, -1.0, 1.0) / np.sqrt(np.mean(pattern**2, axis=0))
    return pattern / values[::-1][:count]


def _face(model: PatientModel) -> np.ndarray:
    return model.skin_points[model.judged_points]
