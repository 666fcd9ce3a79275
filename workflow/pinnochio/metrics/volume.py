"""Error of a displacement field over the tissue and over the skin."""

import numpy as np


def mean_and_p95(name: str, errors: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Mean and 95th percentile of errors (k,), as columns {name}_mean, {name}_p95.

    weights (k,): how much volume or area each stands for, so that a mesh is not judged by where its nodes are dense.
    """
    p95 = np.quantile(errors, 0.95, weights=weights, method="inverted_cdf")
    return {f"{name}_mean": float(np.average(errors, weights=weights)), f"{name}_p95": float(p95)}
