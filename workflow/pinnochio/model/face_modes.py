"""Smooth patterns of the face that correspond between patients, symmetric and antisymmetric, the broadest first."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import cdist

from pinnochio.geometry.scattered import farthest
from pinnochio.model.correspondence import ACROSS, marks, mirrored_marks
from pinnochio.model.patient import PatientModel

SYMMETRIC, ANTISYMMETRIC = 80, 20  # more say no more of 32 patients [X: docs/lab/networks.md]
POINTS, WIDTH = 700, 7.0  # of half a face; mm over which the patterns are smooth at least [X]
MIDLINE = 1.0  # mm from it on which no point stands
SIGNS = np.repeat([1.0, -1.0], [SYMMETRIC, ANTISYMMETRIC])  # of the patterns when left and right are exchanged


@dataclass(frozen=True)
class FaceModes:
    """Patterns on a symmetric template: landmarks (l, 3) mm, points (h, 3) mm of its right half.

    The patterns are the lowest modes of the graph that a Gaussian kernel makes of the points and their mirror images.
    """

    landmarks: np.ndarray
    points: np.ndarray

    @classmethod
    def of(cls, models: Sequence[PatientModel]) -> "FaceModes":
        """Of some patients: their mean landmarks, and the first one's face."""
        known = [marks(model) for model in models]
        both = [each - each.mean(axis=0) for one in known for each in (one, mirrored_marks(one))]
        landmarks = np.mean(both, axis=0)
        face = carried(models[0], landmarks) * ACROSS
        half = np.where(face[:, :1] < 0, face, face * ACROSS)
        half = half[half[:, 0] < -MIDLINE]
        return cls(landmarks, half[farthest(half, POINTS)])

    def __call__(self, model: PatientModel) -> np.ndarray:
        """The patterns (k, q) at the points of a patient's judged face, mean square 1 over the template."""
        here, there = (self._near(carried(model, self.landmarks), side) for side in (1.0, ACROSS))
        (even, even_values), (odd, odd_values) = self._modes
        shown = np.hstack([(here + there) @ (even / even_values), (here - there) @ (odd / odd_values)])
        return shown / np.maximum((here + there).sum(axis=1, keepdims=True), 1e-9)

    def _near(self, places: np.ndarray, side) -> np.ndarray:
        return np.exp(-0.5 * cdist(places, self.points * side, "sqeuclidean") / WIDTH**2)

    @cached_property
    def _modes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Patterns (h, q) at the points and their eigenvalues (q,), symmetric and antisymmetric."""
        here, there = self._near(self.points, 1.0), self._near(self.points, ACROSS)
        degree = np.sqrt((here + there).sum(axis=1))
        modes = []
        for sign, count in ((1.0, SYMMETRIC), (-1.0, ANTISYMMETRIC)):
            values, vectors = np.linalg.eigh((here + sign * there) / np.outer(degree, degree))
            pattern = vectors[:, ::-1][:, :count] / degree[:, None]
            modes.append((pattern / np.sqrt(np.mean(pattern**2, axis=0)), values[::-1][:count]))
        return modes


def carried(model: PatientModel, landmarks: np.ndarray) -> np.ndarray:
    """Points (k, 3) mm of a patient's judged face on the template with these landmarks (l, 3) mm: a thin-plate spline
    takes the patient's landmarks there, smoothed a little, because on a coarse face two may fall together."""
    spline = RBFInterpolator(marks(model), landmarks, smoothing=1.0, kernel="thin_plate_spline", degree=1)
    return spline(model.skin_points[model.judged_points])
