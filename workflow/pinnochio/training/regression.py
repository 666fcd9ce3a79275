"""Regression of many values at once from few patients, whose form and penalty leaving patients out chooses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

PENALTIES = 10.0 ** np.arange(-2, 4.0)  # of a kernel whose mean diagonal is one
WIDTHS = (1.0, 2.0)  # of the Gaussian kernel, by the root mean square distance of two rows [I]
FORMS = ("zero", "mean", "linear", "kernel", "both")  # the simplest first
PARTS = 8  # into which the owners are dealt, each predicted from the others


@dataclass(frozen=True)
class Regression:
    """Values (v,) of a row (f,): constant (v,) and, for each of its kernels, coefficients (r, v) of the rows (r, f).

    rows: standardised by mean (f,) and scale (f,), what is not known as the mean. widths (k,): of the kernels, 0
    for the linear one. error: mean cost of predicting values left out over that of predicting none.
    """

    mean: np.ndarray
    scale: np.ndarray
    rows: np.ndarray
    constant: np.ndarray
    widths: np.ndarray
    coefficients: np.ndarray
    error: float

    @property
    def form(self) -> str:
        """Which of FORMS it is."""
        linear = self.widths == 0
        if not len(linear):
            return "mean" if self.constant.any() else "zero"
        return "both" if len(linear) > 1 else "linear" if linear[0] else "kernel"

    def __call__(self, row: np.ndarray) -> np.ndarray:
        """The values (v,) of a row (f,)."""
        scaled = standardised(row[None], self.mean, self.scale)
        parts = [
            kernel(scaled, self.rows, width)[0] @ weights
            for width, weights in zip(self.widths, self.coefficients, strict=True)
        ]
        return self.constant + (np.mean(parts, axis=0) if parts else 0)


def mean_square(errors: np.ndarray) -> np.ndarray:
    """Of each row of errors (r, v)."""
    return np.square(errors).mean(axis=1)


def regress(
    rows: np.ndarray,
    group: np.ndarray,
    values: np.ndarray,
    owner: np.ndarray,
    cost: Callable[[np.ndarray], np.ndarray] = mean_square,
) -> Regression:
    """The form and the penalty that predict each owner's rows best from those of others.

    rows (r, f), NaN where something is not known; group (f,): features of one group count together as much as those of
    another; values (r, v); owner (r,): rows of one owner stay together; cost: of errors (r, v) of the values, one
    number for each row (r,). The mean of both kernels' predictions is the form "both". The simplest form is taken that
    costs owners more than the best one does by no more than one standard error of that difference (after Breiman et
    al., Classification and Regression Trees, 1984 [R]). Deterministic: owners are dealt to parts in their order.
    """
    known = np.isfinite(rows).any(axis=0)
    mean, scale = (np.where(known, each(np.where(known, rows, 0), axis=0), 0.0) for each in (np.nanmean, np.nanstd))
    scale = np.where(scale < 1e-9, 1.0, scale) * np.sqrt(np.bincount(group)[group] * len(np.unique(group)) / len(group))
    rows = standardised(rows, mean, scale)
    owners, number = np.unique(owner, return_inverse=True)
    part = number % min(PARTS, len(owners))

    def left_out(width: float | None, penalty: float) -> np.ndarray:
        predicted = np.empty_like(values, float)
        for each in np.unique(part):
            out = part == each
            predicted[out] = _predict(rows[~out], values[~out], rows[out], width, penalty) if not out.all() else 0
        return predicted

    def costs(predicted: np.ndarray) -> np.ndarray:
        return np.bincount(number, cost(predicted - values)) / np.bincount(number)

    def best(widths: Sequence[float]) -> tuple[float, float, np.ndarray]:
        tried = [(width, penalty, left_out(width, penalty)) for width in widths for penalty in PENALTIES]
        return min(tried, key=lambda each: costs(each[2]).mean())

    chosen = {"linear": best([0.0]), "kernel": best(WIDTHS)}
    fields = {"zero": np.zeros(values.shape), "mean": left_out(None, 1.0)} | {
        form: each[2] for form, each in chosen.items()
    }
    fields["both"] = 0.5 * (fields["linear"] + fields["kernel"])
    by_form = {form: costs(fields[form]) for form in FORMS}
    form = _simplest(by_form)
    kernels = {"zero": [], "mean": [], "both": list(chosen.values())}.get(form, [chosen.get(form)])
    constant = values.mean(axis=0) * (form != "zero")
    return Regression(
        mean=mean,
        scale=scale,
        rows=rows,
        constant=constant,
        widths=np.array([width for width, _, _ in kernels]),
        coefficients=np.array(
            [_solve(rows, values - constant, width, penalty) for width, penalty, _ in kernels]
        ).reshape(-1, *values.shape),
        error=by_form[form].mean() / by_form["zero"].mean(),
    )


def _simplest(costs: Mapping[str, np.ndarray]) -> str:
    """The simplest form that is not told apart from the best; costs: (o,) of every owner, by form."""
    best = min(FORMS, key=lambda form: costs[form].mean())
    for form in FORMS:
        more = costs[form] - costs[best]
        if form == best or more.mean() <= more.std(ddof=1) / np.sqrt(len(more)):
            return form


def standardised(rows: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The rows (r, f) by mean (f,) and scale (f,); 0 where something is not known."""
    return np.nan_to_num((rows - mean) / scale)


def kernel(rows: np.ndarray, others: np.ndarray, width: float) -> np.ndarray:
    """Kernel (r, o) of rows (r, f) and others (o, f): linear for width 0, else Gaussian, `width` in units of the root
    mean square distance of two standardised rows."""
    count = rows.shape[1]
    if width == 0:
        return rows @ others.T / count
    return np.exp(-cdist(rows, others, "sqeuclidean") / (4 * count * width**2))


def _solve(rows, values, width: float, penalty: float) -> np.ndarray:
    return np.linalg.solve(kernel(rows, rows, width) + penalty * np.eye(len(rows)), values)


def _predict(rows, values, others, width: float | None, penalty: float) -> np.ndarray:
    """Values of others from the rows; width None: their mean."""
    constant = values.mean(axis=0)
    if width is None:
        return np.broadcast_to(constant, (len(others), len(constant)))
    return constant + kernel(others, rows, width) @ _solve(rows, values - constant, width, penalty)
