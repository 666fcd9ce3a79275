"""Rigid motions in LPS millimetres."""

from dataclasses import dataclass, field

import numpy as np
import scipy

# scipy.spatial, whose import takes a third of a second, is imported where a motion first turns.
LARGEST_TRANSLATION = 50.0  # mm; a longer one is a wrong unit or a wrong file
NEARLY = 1e-3  # of R'R = I: what rounding to a few decimals leaves, 0.1 mm at 100 mm


def nearest_rotation(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """The rotation (3, 3) nearest to a matrix, and the largest entry of R'R - I; infinite for one that mirrors."""
    off = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    left, _, right = np.linalg.svd(matrix)
    return left @ right, off if np.linalg.det(matrix) > 0 else np.inf


@dataclass(frozen=True)
class RigidMotion:
    """x_post = R (x_pre - pivot) + pivot + translation; rotation (3, 3), translation and pivot (3,) in mm."""

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    pivot: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moved points, (n, 3) mm."""
        return (points - self.pivot) @ self.rotation.T + self.pivot + self.translation

    def inverse(self, points: np.ndarray) -> np.ndarray:
        """Points before the motion, (n, 3) mm."""
        return (points - self.pivot - self.translation) @ self.rotation + self.pivot

    def displacement(self, points: np.ndarray) -> np.ndarray:
        """apply(points) - points, (n, 3) mm."""
        return self.apply(points) - points

    def fraction(self, share: float) -> "RigidMotion":
        """The motion carried out to `share` in [0, 1]: rotation by its angle, translation linearly."""
        turned = scipy.spatial.transform.Rotation.from_rotvec(
            share * scipy.spatial.transform.Rotation.from_matrix(self.rotation).as_rotvec()
        )
        return RigidMotion(turned.as_matrix(), share * self.translation, self.pivot)

    def about(self, pivot: np.ndarray) -> "RigidMotion":
        """The same motion with another pivot (3,) mm."""
        return RigidMotion(self.rotation, self.displacement(pivot[None])[0], pivot)

    @property
    def back(self) -> "RigidMotion":
        """The motion that undoes this one."""
        pivot = self.pivot + self.translation
        return RigidMotion(self.rotation.T, -self.translation, pivot)

    @property
    def degrees(self) -> np.ndarray:
        """Components (3,) of the rotation vector, as :meth:`from_degrees` takes them."""
        return scipy.spatial.transform.Rotation.from_matrix(self.rotation).as_rotvec(degrees=True)

    @property
    def angle(self) -> float:
        """How far it turns, degrees."""
        return float(np.degrees(scipy.spatial.transform.Rotation.from_matrix(self.rotation).magnitude()))

    def angle_from(self, other: "RigidMotion") -> float:
        """How far it turns beyond another, degrees."""
        return RigidMotion(self.rotation @ other.rotation.T).angle

    @classmethod
    def from_degrees(cls, angles, translation, pivot) -> "RigidMotion":
        """From rotation-vector components in degrees about the x (pitch), y (roll) and z (yaw) axes."""
        rotation = scipy.spatial.transform.Rotation.from_rotvec(np.asarray(angles, float), degrees=True).as_matrix()
        return cls(rotation, np.asarray(translation, float), np.asarray(pivot, float))
