"""The motion that meets a wish: Gauss-Newton on the elastic map, corrected by finite elements."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from pinnochio.inverse.face import Face
from pinnochio.inverse.freedom import Freedom
from pinnochio.inverse.wish import Wish, misfit, stacked
from pinnochio.plans.plan import Plan

ITERATIONS = 30  # Gauss-Newton steps
SMALL = 1e-3  # mm of bone: a smaller step ends the search
AT_BOUND = 1e-3  # mm or degrees from a bound: the proposal lies on it


@dataclass(frozen=True)
class InverseSettings:
    """The part of section `invert` of the configuration that decides about a proposal.

    least_motion: mm of misfit that one mm of bone motion counts as; met: error within which a wish is met, mm (or its
    unit); tolerance: root mean square change of the wished face that nobody tells, mm; corrections: finite-element
    solutions that correct the elastic map, at most.
    """

    least_motion: float
    met: float
    tolerance: float
    corrections: int


@dataclass(frozen=True)
class Proposal:
    """A plan that comes as near to a wish as its operation can.

    x (p,): its parameters; displacement (n, 3) mm: finite elements of it, or what is expected of them where `solved`
    is false; gap, mm: root mean square distance on the judged face
    between that and the elastic map; misfit, mm: weighted root mean square of the wishes' errors; at_bounds: block
    and quantity of parameters that lie on a bound; corrections: finite-element solutions; seconds: of the elastic
    proposal and of all.
    """

    operation: str
    plan: Plan
    x: np.ndarray
    displacement: np.ndarray
    solved: bool
    gap: float
    misfit: float
    at_bounds: Sequence[tuple[str, str]]
    corrections: int
    seconds_elastic: float
    seconds: float


class Search:
    """One patient, one wish, one operation: the nearest face within its freedom."""

    def __init__(self, face: Face, wish: Wish, freedom: Freedom, settings: InverseSettings):
        self._face, self._wish, self._freedom, self._settings = face, wish, freedom, settings
        # What finite elements add to the elastic map: off + slope @ (x - at), mm of the nodes' coordinates.
        self._off = np.zeros(face.response.shape[1])
        self._slope = np.zeros((face.response.shape[1], len(freedom.low)))
        self._at = np.zeros(len(freedom.low))

    def field(self, x: np.ndarray) -> np.ndarray:
        """Displacement (n, 3) mm that is expected of the parameters x (p,)."""
        added = self._off + self._slope @ (x - self._at)
        return self._face.elastic(self._freedom.amplitudes(x)) + added.reshape(-1, 3)

    def derivative(self, x: np.ndarray) -> np.ndarray:
        """Its derivative (3 n, p)."""
        return self._face.response.T @ self._freedom.derivative(x) + self._slope

    def elastic(self, start: np.ndarray) -> np.ndarray:
        """Parameters (p,) within their bounds by Gauss-Newton from `start` (p,)."""
        x, own = np.array(start), self._freedom
        price = self._settings.least_motion * own.lever
        value = self._cost(x, price)
        for _ in range(ITERATIONS):
            residual, rows = stacked(self._wish, self.field(x))
            slope = rows @ self.derivative(x)
            # The triangle of the QR factors stands for thousands of rows.
            triangle = np.linalg.qr(
                np.vstack([np.column_stack([slope, residual]), np.zeros((len(x) + 1, len(x) + 1))])
            )[1]
            matrix = np.vstack([triangle[:, :-1], np.diag(price)])
            step = lsq_linear(
                matrix, -np.concatenate([triangle[:, -1], price * x]), _opened(own.low - x, own.high - x), tol=1e-12
            ).x
            for halvings in range(8):
                new = np.clip(x + 0.5**halvings * step, own.low, own.high)
                after = self._cost(new, price)
                if after <= value:
                    break
            else:
                return x
            done = np.abs(own.lever * (new - x)).max(initial=0.0) < SMALL
            x, value = new, after
            if done:
                return x
        return x

    def _cost(self, x, price) -> float:
        residual = stacked(self._wish, self.field(x))[0]
        return float(residual @ residual + (price * x) @ (price * x))

    def corrected(self, x: np.ndarray, field: np.ndarray) -> None:
        """Take note of the field (n, 3) mm that finite elements give for x (p,): exact there, and by Broyden's update
        in the direction that was gone since the last one."""
        added = field.ravel() - self._face.elastic(self._freedom.amplitudes(x)).ravel()
        step = self._freedom.lever**2 * (x - self._at)
        if (length := step @ (x - self._at)) > SMALL**2:
            self._slope += np.outer(added - self._off - self._slope @ (x - self._at), step) / length
        self._off, self._at = added, np.array(x)


def propose(
    face: Face, wish: Wish, freedom: Freedom, operation: str, case: str, settings: InverseSettings
) -> tuple[Proposal, Search]:
    """The proposal of an operation, and the search that made it.

    Finite elements correct the elastic map until a step moves no bone by a tenth of the tolerance; the best of the
    solved plans counts, whose face is that of finite elements. Without corrections, or where they do not converge, it
    is that of the elastic map.
    """
    began = time.perf_counter()
    search = Search(face, wish, freedom, settings)
    x = search.elastic(np.clip(np.zeros(len(freedom.low)), freedom.low, freedom.high))
    elastic = time.perf_counter() - began
    best, made = None, 0
    while made < settings.corrections:
        result = face.solve(freedom.plan(case, x))
        made += 1
        if not result.converged:
            break
        price = settings.least_motion * freedom.lever * x
        cost = np.sum(stacked(wish, result.displacement)[0] ** 2) + price @ price
        if best is None or cost < best[0]:
            best = cost, x, result.displacement
        search.corrected(x, result.displacement)
        new = search.elastic(x)
        moved = np.abs(freedom.lever * (new - x)).max(initial=0.0)
        x = new
        if moved < 0.1 * settings.tolerance:
            break
    if best is not None:
        x = best[1]
    field = best[2] if best is not None else search.field(x)
    model = face.model
    gap = (model.moved_skin(field) - model.moved_skin(face.elastic(freedom.amplitudes(x))))[model.judged_points]
    at = (x - freedom.low < AT_BOUND) | (freedom.high - x < AT_BOUND)
    proposal = Proposal(
        operation=operation,
        plan=freedom.plan(case, x),
        x=x,
        displacement=field,
        solved=best is not None,
        gap=float(np.sqrt((gap**2).sum(axis=1).mean())),
        misfit=misfit(wish, field),
        at_bounds=[name for name, own in zip(freedom.names, at, strict=True) if own],
        corrections=made,
        seconds_elastic=elastic,
        seconds=time.perf_counter() - began,
    )
    return proposal, search


def _opened(low, high) -> tuple[np.ndarray, np.ndarray]:
    """Bounds with some room between them, which lsq_linear wants."""
    return np.minimum(low, -1e-9), np.maximum(high, 1e-9)
