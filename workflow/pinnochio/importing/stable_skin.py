"""Which skin stays where it was, and the rigid motion that this makes most likely, with how far it may be off.

Forehead and bridge of the nose lie close on bone that no operation moves. The thicker the tissue and the farther below
the forehead, the more the skin is elsewhere when it is scanned again: posture, swelling, expression. So a point counts
by what its skin does and by what its neighbours tell already, as generalised least squares have it: the covariance of
the offsets holds the scan's noise and the skin's motion, both of which neighbours share.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from pinnochio.geometry.closest_points import closest_points
from pinnochio.model.surfaces import BoneSurface
from pinnochio.seeds import generator

SMOOTH, PATCH = 0.83, 8.0  # share of the noise's SD that is smooth, and over what length, mm: that of a camera [I]
LEAST = 0.1  # mm of noise that every scan has
# SD in mm by which skin is elsewhere over THIN mm of tissue, FOREHEAD mm above the nasion plane; the length in mm in
# which that grows e-fold downward; the length in mm over which skin moves together; and its largest [X: virtual heads].
MOVES, FOREHEAD, GROWS, TOGETHER, MOST = 0.3, 25.0, 5.0, 45.0, 5.0
THIN = 5.0
DRAWS = 200  # motions from which percentiles are taken
BOUND = 1.96  # standard deviations: 95 %


@dataclass(frozen=True)
class Certainty:
    """How far a rigid motion may be off: covariance (6, 6) of turn (radians) about `centre` (3,) mm and shift (mm)."""

    centre: np.ndarray
    covariance: np.ndarray

    @classmethod
    def none(cls) -> "Certainty":
        """Of a motion of which nothing is known."""
        return cls(np.zeros(3), np.full((6, 6), np.nan))

    def on(self, points, normals) -> tuple[float, float]:
        """Of a surface's points (k, 3) mm with normals: the 95th percentile of the distance along the normals by which
        it may be off, over points and motions; and the bound that the mean of that distance keeps in 95 %; mm, NaN
        without a point or where nothing is known."""
        if not len(points) or not np.isfinite(self.covariance).all():
            return np.nan, np.nan
        rows = np.hstack([np.cross(points - self.centre, normals), normals])
        drawn = generator(0, "registration", "-").multivariate_normal(np.zeros(6), self.covariance, DRAWS)
        mean = rows.mean(axis=0)
        bias = BOUND * float(np.sqrt(mean @ self.covariance @ mean))
        return float(np.percentile(np.abs(rows @ drawn.T), 95)), bias


def unstable(points, plane: float, bone: BoneSurface | None) -> np.ndarray:
    """SD (k,) mm by which skin at the points (k, 3) mm is elsewhere in another scan; plane: z (mm) of the nasion plane.

    Without a bone nothing is known of it, and all skin counts alike: zero.
    """
    if bone is None:
        return np.zeros(len(points))
    thickness = closest_points(points, bone.points, bone.faces).distance
    return np.minimum(MOVES * np.exp((FOREHEAD + plane - points[:, 2]) / GROWS) * thickness / THIN, MOST)


def likeliest(places, offsets, normals, moves) -> tuple[np.ndarray, Certainty, np.ndarray]:
    """Turn and shift (6,) about the places' mean that explain the offsets (k,) mm along the normals (k, 3) of places
    (k, 3) mm best, where skin moves (k,) mm, SD; how certain that is; and the weight (k,) that each offset has.

    The noise is that of the offsets where skin moves least. Offsets beyond 4.7 of their standard deviations (hair,
    swelling, artefacts) count nothing, as by Tukey's weight; if the rest is larger than expected, so is the covariance.
    """
    firm = moves <= np.median(moves)
    noise = max(1.4826 * float(np.median(np.abs(offsets[firm]))), LEAST)
    weights = np.clip(1 - (offsets / (4.685 * np.hypot(noise, moves))) ** 2, 0, None) ** 2
    used = weights > 1e-3
    where, way, off = places[used], normals[used], offsets[used]
    apart, way_moved = cdist(where, where, "sqeuclidean"), moves[used, None] * way
    spread = np.exp(apart * (-1 / (2 * PATCH**2))) * (noise * SMOOTH) ** 2
    if moves.any():
        spread += np.exp(apart * (-1 / (2 * TOGETHER**2))) * (way_moved @ way_moved.T)
    spread[np.diag_indices(len(where))] += noise**2 * (1 / weights[used] - SMOOTH**2)
    centre = where.mean(axis=0)
    rows = np.hstack([np.cross(where - centre, way), way])
    factor = cho_factor(spread, overwrite_a=True, check_finite=False)
    solved = cho_solve(factor, rows)
    covariance = np.linalg.inv(rows.T @ solved + 1e-8 * np.eye(6))
    motion = covariance @ (solved.T @ off)
    left = off - rows @ motion
    larger = max(1.0, float(left @ cho_solve(factor, left)) / max(len(off) - 6, 1))
    return motion, Certainty(centre, larger * covariance), weights
