"""The motion that meets a wish: Gauss-Newton on the elastic map, corrected by finite elements."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import lsq_linear

from pinnochio.plans.plan import Plan
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import Freedom
from studies.inverse.wish import Wish, misfit, stacked

ITERATIONS = 30  # Gauss-Newton steps
SMALL = 1e-3  # mm of bone: a smaller step ends the search
# mm of misfit that one mm of bone motion counts as: at least, so that every motion has a price, and at most.
CHEAPEST, DEAREST = 0.002, 5.0
HALVINGS = 12  # of the interval between them, in powers of ten
ENOUGH = 0.01  # mm of bone (root mean square): a smaller correction is none
AT_BOUND = 1e-3  # mm or degrees from a bound: the proposal lies on it


@dataclass(frozen=True)
class InverseSettings:
    """The part of section `invert` of the configuration that decides about a proposal.

    met: error within which a wish is met, mm (or its unit); tolerance: root mean square change of the wished face that
    nobody tells, mm: of the plans that miss the wish by no more than the best one and this, the least motion is
    proposed; corrections: finite-element solutions that correct the elastic map, at most.
    """

    met: float
    tolerance: float
    corrections: int

    @classmethod
    def of(cls, section: Mapping) -> "InverseSettings":
        """From the section."""
        return cls(**{item.name: section[item.name] for item in fields(cls)})


@dataclass(frozen=True)
class Proposal:
    """A plan that comes as near to a wish as an operation can.

    x (p,): its parameters; displacement (n, 3) mm: finite elements of it, or what is expected of them where `solved`
    is false; misfit, mm: weighted root mean square of the wishes' errors; at_bounds: block and quantity of parameters
    that lie on a bound; corrections: finite-element solutions; seconds: of all.
    """

    plan: Plan
    x: np.ndarray
    displacement: np.ndarray
    solved: bool
    misfit: float
    at_bounds: Sequence[tuple[str, str]]
    corrections: int
    seconds: float


class Search:
    """One patient, one wish, one operation: the nearest face within its freedom."""

    def __init__(self, face: ElasticFace, wish: Wish, freedom: Freedom, settings: InverseSettings):
        self._face, self._wish, self._freedom, self._settings = face, wish, freedom, settings
        # What finite elements add to the elastic map: off + slope @ (x - at), mm of the nodes' coordinates.
        self._off = np.zeros(face.response.shape[1])
        self._slope = np.zeros((face.response.shape[1], len(freedom.low)))
        self._at = np.zeros(len(freedom.low))
        self.price = CHEAPEST
        self._last = None  # parameters, and the residuals and their derivative by the nodes there

    def field(self, x: np.ndarray) -> np.ndarray:
        """Displacement (n, 3) mm that is expected of the parameters x (p,)."""
        added = self._off + self._slope @ (x - self._at)
        return self._face.elastic(self._freedom.amplitudes(x)) + added.reshape(-1, 3)

    def derivative(self, x: np.ndarray) -> np.ndarray:
        """Its derivative (3 n, p)."""
        return self._face.response.T @ self._freedom.derivative(x) + self._slope

    def elastic(self, start: np.ndarray) -> np.ndarray:
        """Parameters (p,) within their bounds, from `start` (p,): first as near to the wish as can be, then the least
        motion that comes as near but for the tolerance. The price of motion that asks for that is `price`."""
        nearest = self._descend(start, CHEAPEST)
        residual, slope = self._linear(nearest)
        allowed = np.linalg.norm(residual) + self._settings.tolerance
        low, high = np.log10([CHEAPEST, DEAREST])
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            step = self._step(nearest, residual, slope, 10**middle)
            if np.linalg.norm(residual + slope @ step) > allowed:
                high = middle
            else:
                low = middle
        self.price = 10**low
        return self._descend(nearest, self.price)

    def cost(self, x: np.ndarray, field: np.ndarray | None = None) -> float:
        """What is minimised: squared misfit (mm^2) of a field (n, 3) mm, or of the one that is expected, and the price
        of the motion x (p,)."""
        residual, _ = self._stacked(x) if field is None else stacked(self._wish, field)
        priced = self.price * self._freedom.lever * x
        return float(residual @ residual + priced @ priced)

    def _descend(self, start: np.ndarray, price: float) -> np.ndarray:
        """Gauss-Newton from `start` (p,) at a price of motion."""
        x, self.price = np.array(start), price
        value = self.cost(x)
        for _ in range(ITERATIONS):
            step = self._step(x, *self._linear(x), price)
            for halvings in range(8):
                new = np.clip(x + 0.5**halvings * step, self._freedom.low, self._freedom.high)
                after = self.cost(new)
                if after <= value:
                    break
            else:
                return x
            done = np.abs(self._freedom.lever * (new - x)).max(initial=0.0) < SMALL
            x, value = new, after
            if done:
                return x
        return x

    def _stacked(self, x: np.ndarray) -> tuple:
        """As `stacked` at the parameters x (p,); a step that was judged is not looked at again to go on from it."""
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = np.array(x), stacked(self._wish, self.field(x))
        return self._last[1]

    def _linear(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (p + 1,) and its derivative (p + 1, p): the triangle of the QR factors of thousands of rows."""
        residual, rows = self._stacked(x)
        whole = np.column_stack([rows @ self.derivative(x), residual])
        triangle = np.linalg.qr(np.vstack([whole, np.zeros((whole.shape[1], whole.shape[1]))]))[1]
        return triangle[:, -1], triangle[:, :-1]

    def _step(self, x: np.ndarray, residual: np.ndarray, slope: np.ndarray, price: float) -> np.ndarray:
        """The step (p,) to the least cost within the bounds, were all linear."""
        free, weights = self._freedom, price * self._freedom.lever
        matrix, wanted = np.vstack([slope, np.diag(weights)]), -np.concatenate([residual, weights * x])
        # lsq_linear wants some room between the bounds.
        bounds = np.minimum(free.low - x, -1e-9), np.maximum(free.high - x, 1e-9)
        return lsq_linear(matrix, wanted, bounds, tol=1e-12).x

    def corrected(self, x: np.ndarray, field: np.ndarray) -> None:
        """Take note of the field (n, 3) mm that finite elements give for x (p,): exact there, and by Broyden's update
        in the direction that was gone since the last one."""
        added = field.ravel() - self._face.elastic(self._freedom.amplitudes(x)).ravel()
        step = self._freedom.lever**2 * (x - self._at)
        if (length := step @ (x - self._at)) > SMALL**2:
            self._slope += np.outer(added - self._off - self._slope @ (x - self._at), step) / length
        self._off, self._at, self._last = added, np.array(x), None


def propose(
    face: ElasticFace, wish: Wish, freedom: Freedom, case: str, settings: InverseSettings
) -> tuple[Proposal, Search]:
    """The proposal of an operation, and the search that made it.

    Finite elements correct the elastic map until a step moves no bone by ENOUGH; the best of the
    solved plans counts, whose face is that of finite elements. Without corrections, or where they do not converge, it
    is that of the elastic map.
    """
    began = time.perf_counter()
    search = Search(face, wish, freedom, settings)
    x = search.elastic(np.clip(np.zeros(len(freedom.low)), freedom.low, freedom.high))
    solved, made = [], 0
    while made < settings.corrections:
        result = face.solve(freedom.plan(case, x))
        made += 1
        if not result.converged:
            break
        solved.append((x, result.displacement))
        search.corrected(x, result.displacement)
        new = search.elastic(x)
        moved = np.abs(freedom.lever * (new - x)).max(initial=0.0)
        x = new
        if moved < ENOUGH:
            break
    field = search.field(x)
    if solved:
        x, field = min(solved, key=lambda pair: search.cost(*pair))
    at = (x - freedom.low < AT_BOUND) | (freedom.high - x < AT_BOUND)
    proposal = Proposal(
        plan=freedom.plan(case, x),
        x=x,
        displacement=field,
        solved=bool(solved),
        misfit=misfit(wish, field),
        at_bounds=[name for name, bounded in zip(freedom.names, at, strict=True) if bounded],
        corrections=made,
        seconds=time.perf_counter() - began,
    )
    return proposal, search
