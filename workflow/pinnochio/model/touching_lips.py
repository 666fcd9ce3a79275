"""Lips that a field lets cross, brought into contact for what is shown: no method but one models how they touch."""

import numpy as np
from scipy.spatial import cKDTree

from pinnochio.model.patient import LOWER_LIP, NOT_LIP, UPPER_LIP, PatientModel

NEAR, FADE = 5.0, 10.0  # mm within which lips meet, and about them that follow [I]
ROUNDS = 4
CROSSED = 0.3  # mm that lips cross from which it is said [I]


def touching_lips(patient: PatientModel, displacement: np.ndarray) -> tuple[np.ndarray, float]:
    """The field (n, 3) mm with lips that cross beyond what they did before moved apart, up and down by a half each, and
    how far (mm) they crossed at most; 0 for a mesh without a mouth slit."""
    lips = [np.flatnonzero(patient.lip == lip) for lip in (UPPER_LIP, LOWER_LIP)]
    moved, crossed, points = np.array(displacement, float), 0.0, patient.points
    if not all(map(len, lips)):
        return moved, crossed
    before = [np.maximum(depth, 0) for depth in _depths(points, lips)]
    away, nearest = cKDTree(points[np.concatenate(lips)]).query(points)
    above = points[:, 2] > points[np.concatenate(lips)][nearest, 2]
    above = np.where(patient.lip == NOT_LIP, above, patient.lip == UPPER_LIP)
    around = [cKDTree(points[lip]).query(points) for lip in lips]
    for _ in range(ROUNDS):
        depths = [np.maximum(d - b, 0) for d, b in zip(_depths(points + moved, lips), before, strict=True)]
        crossed = max(crossed, *(float(depth.max()) for depth in depths))
        for side, depth, (off, near) in zip((above, ~above), depths, around, strict=True):
            share = np.where(side, np.clip(1 - off / FADE, 0, 1) ** 2, 0)
            moved[:, 2] += (0.5 if side is above else -0.5) * share * depth[near]
    return moved, crossed


def shown_skin(patient: PatientModel, displacement: np.ndarray) -> np.ndarray:
    """Points (s, 3) mm of the skin under a field (n, 3) mm, without crossing lips."""
    return patient.moved_skin(touching_lips(patient, displacement)[0])


def _depths(points: np.ndarray, lips: list[np.ndarray]) -> list[np.ndarray]:
    """How far (mm) each node of the upper and of the lower lip lies below, or above, the other one."""
    depths = []
    for lip, other, down in ((lips[0], lips[1], 1.0), (lips[1], lips[0], -1.0)):
        away, near = cKDTree(points[other, :2]).query(points[lip, :2], k=min(3, len(other)), distance_upper_bound=NEAR)
        away, near = away.reshape(len(lip), -1), near.reshape(len(lip), -1)
        weights = np.where(np.isfinite(away), 1 / (away + 0.1), 0)
        height = (weights * points[other, 2][np.minimum(near, len(other) - 1)]).sum(axis=1)
        height /= np.maximum(weights.sum(axis=1), 1e-9)
        depths.append(np.where(weights.any(axis=1), down * (height - points[lip, 2]), 0))
    return depths
