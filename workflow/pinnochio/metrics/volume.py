"""Error of a displacement field against a truth that is known on another mesh."""

import numpy as np

from pinnochio.geometry.interpolation import interpolate


def truth_errors(points, displacement, truth_points, truth_cells, truth) -> np.ndarray:
    """|u - truth| (k,) mm of a displacement (k, 3) mm at points (k, 3) mm; the truth is a field as in interpolate."""
    return np.linalg.norm(displacement - interpolate(points, truth_points, truth_cells, truth), axis=1)


def mean_and_p95(name: str, errors: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Mean and 95th percentile of errors (k,), as columns {name}_mean, {name}_p95.

    weights (k,): how much volume or area each stands for, so that a mesh is not judged by where its nodes are dense.
    """
    p95 = np.quantile(errors, 0.95, weights=weights, method="inverted_cdf")
    return {f"{name}_mean": float(np.average(errors, weights=weights)), f"{name}_p95": float(p95)}
