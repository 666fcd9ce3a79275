"""Which motions a wish cannot tell apart: combinations of the bones' motions that the wished face hardly feels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinnochio.geometry.rigid import RigidMotion
from pinnochio.model.bones import segment_points
from pinnochio.plans.surgery import segment_in_words
from studies.inverse.freedom import LPS, QUANTITIES, Freedom
from studies.inverse.proposal import Search
from studies.inverse.wish import stacked

MOST_BONE = 1.0  # mm of bone that change the wish by the tolerance: a combination that needs more is not told apart [I]
LARGEST = 5.0  # mm of bone by which a combination is shown, at most


@dataclass(frozen=True)
class Combinations:
    """Directions of the parameters by what the wish feels of them, the least felt first.

    directions (p, p): rows, in parameters per mm of bone motion (root mean square over the blocks' bones); felt (p,):
    mm of the wish per mm of bone; bone (p,): mm of bone that change the wish by the tolerance, infinite where it feels
    nothing.
    """

    directions: np.ndarray
    felt: np.ndarray
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
        return Combinations(vectors.T[order] / freedom.lever, felt[order], tolerance / felt[order])


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


def as_motions(freedom: Freedom, x: np.ndarray, change: np.ndarray) -> dict[str, np.ndarray]:
    """What a change (p,) of parameters at x (p,) does to each segment: the QUANTITIES (6,), mm at the middle of its
    bone and degrees; segments that stay are left out."""
    before, after = freedom.plan("-", x), freedom.plan("-", x + change)
    return differences(freedom, before.motions, after.motions)


def differences(freedom: Freedom, before: dict[str, RigidMotion], after: dict[str, RigidMotion]) -> dict:
    """QUANTITIES (6,) of the way from one motion of each segment to another, mm at the middle of its bone, degrees."""
    changes = {}
    for name, bone in segment_points(freedom.model).items():
        if name in before or name in after:
            one, other = before.get(name, RigidMotion()), after.get(name, RigidMotion())
            middle = bone.mean(axis=0)[None]
            turn = RigidMotion(other.rotation @ one.rotation.T).degrees
            values = np.concatenate([LPS * (other.apply(middle) - one.apply(middle))[0], turn])
            if np.abs(values).max() > 1e-9:
                changes[name] = values
    return changes


def in_words(motions: dict[str, np.ndarray], least: float = 0.05) -> str:
    """Motions of segments, (6,) each, in words; what is less than `least` (mm, degrees) is left out."""
    opposite = {"left": "right", "forward": "back", "up": "down"}
    parts: Sequence[str] = []
    for name, values in motions.items():
        words = []
        for quantity, value in zip(QUANTITIES, values, strict=True):
            if abs(value) >= least:
                word = opposite[quantity] if value < 0 and quantity in opposite else quantity
                size = abs(value) if quantity in opposite else value
                words.append(f"{size:.1f} mm {word}" if quantity in opposite else f"{quantity} {size:+.1f}°")
        if words:
            parts = [*parts, f"{segment_in_words(name)}: {', '.join(words)}"]
    return "; ".join(parts) or "no motion"
