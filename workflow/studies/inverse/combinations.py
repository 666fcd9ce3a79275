"""Which motions a wish cannot tell apart: combinations of the bones' motions that the wished face hardly feels."""

from dataclasses import dataclass

import numpy as np

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.bones import segment_points
from studies.inverse.freedom import LPS, QUANTITIES, Freedom
from studies.inverse.proposal import Search
from studies.inverse.wish import stacked

MOST_BONE = 1.0  # mm of bone that change the wish by the tolerance: a combination that needs more is not told apart [I]
LARGEST = 5.0  # mm of bone by which a combination is shown, at most


@dataclass(frozen=True)
class Combinations:
    """Directions of the parameters by what the wish feels of them, the least felt first.

    directions (p, p): rows, in parameters per mm of bone motion (root mean square over the blocks' bones); bone (p,):
    mm of bone that change the wish by the tolerance, infinite where it feels nothing.
    """

    directions: np.ndarray
    bone: np.ndarray

    @property
    def hidden(self) -> np.ndarray:
        """Which of them (p,) bool the wish cannot tell."""
        return self.bone > MOST_BONE


def combinations(search: Search, freedom: Freedom, wish, x: np.ndarray, tolerance: float) -> Combinations:
    """Singular vectors of the wish's derivative at the parameters x (p,); tolerance in mm.

    Those that the wish cannot tell are turned among themselves so that each moves as few bones as it can (varimax).
    """
    _, rows = stacked(wish, search.field(x))
    slope = (rows @ search.derivative(x)) / freedom.lever
    values, vectors = np.linalg.eigh(slope.T @ slope)
    hidden = np.sqrt(np.maximum(values, 0)) * MOST_BONE < tolerance
    vectors[:, hidden] = varimax(vectors[:, hidden])
    felt = np.linalg.norm(slope @ vectors, axis=0)
    order = np.argsort(felt, kind="stable")
    with np.errstate(divide="ignore"):
        return Combinations(vectors.T[order] / freedom.lever, tolerance / felt[order])


def varimax(basis: np.ndarray, turns: int = 100) -> np.ndarray:
    """An orthonormal basis (p, k) of the same space whose columns have few large entries (Kaiser 1958)."""
    rows, count = basis.shape
    turned = np.eye(count)
    for _ in range(turns if count > 1 else 0):
        loads = basis @ turned
        left, _, right = np.linalg.svd(basis.T @ (loads**3 - loads * (loads**2).sum(axis=0) / rows))
        new = left @ right
        if np.abs(new - turned).max() < 1e-8:
            break
        turned = new
    return basis @ turned


def as_motions(freedom: Freedom, x: np.ndarray, change: np.ndarray) -> dict[str, RigidMotion]:
    """What a change (p,) of parameters at x (p,) does to each segment, about the middle of its bone; segments that stay
    are left out."""
    before, after = freedom.plan("-", x), freedom.plan("-", x + change)
    changes = {}
    for name, bone in segment_points(freedom.model).items():
        middle = bone.mean(axis=0)
        one, other = before.motion(name), after.motion(name)
        turn = RigidMotion(other.rotation @ one.rotation.T).degrees
        shift = (other.apply(middle[None]) - one.apply(middle[None]))[0]
        if max(np.abs(shift).max(), np.abs(turn).max()) > 1e-9:
            changes[name] = RigidMotion.from_degrees(turn, shift, middle)
    return changes


def quantities(motion: RigidMotion) -> dict[str, float]:
    """QUANTITIES of a motion, mm of its pivot and degrees."""
    return dict(zip(QUANTITIES, [*(LPS * motion.translation), *motion.degrees], strict=True))
