"""Error of a displacement field against a truth that is known on another mesh."""

import os

import h5py
import numpy as np
import pyvista as pv

from pinnochio.plans.plan import Plan


def interpolate(queries, points, cells, displacement) -> np.ndarray:
    """Displacement (k, 3) mm at queries (k, 3) of a field on tetrahedra points (n, 3), cells (m, 4).

    A query outside the mesh takes the value at the closest point of the mesh.
    """
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: np.asarray(cells)}, np.asarray(points, float))
    cell, nearest = grid.find_closest_cell(np.asarray(queries, float), return_closest_point=True)
    cell, nearest = np.atleast_1d(cell), np.atleast_2d(nearest)
    corners = points[cells[cell]]
    edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 2)
    inner = np.linalg.solve(edges, (nearest - corners[:, 0])[..., None])[..., 0]
    weights = np.concatenate([1 - inner.sum(axis=1, keepdims=True), inner], axis=1)
    return np.einsum("kc,kcd->kd", weights, displacement[cells[cell]])


def truth_errors(points, displacement, truth_points, truth_cells, truth) -> np.ndarray:
    """|u - truth| (k,) mm of a displacement (k, 3) mm at points (k, 3) mm; the truth is a field as in interpolate."""
    return np.linalg.norm(displacement - interpolate(points, truth_points, truth_cells, truth), axis=1)


def mean_and_p95(name: str, errors: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Mean and 95th percentile of errors (k,), as columns {name}_mean, {name}_p95.

    weights (k,): how much volume or area each stands for, so that a mesh is not judged by where its nodes are dense.
    """
    p95 = np.quantile(errors, 0.95, weights=weights, method="inverted_cdf")
    return {f"{name}_mean": float(np.average(errors, weights=weights)), f"{name}_p95": float(p95)}


def read_truth(path: str | os.PathLike, case: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, Plan]:
    """Points (n, 3) mm, cells (m, 4), displacement (n, 3) mm and the executed plan of a simulated outcome.

    No method sees them.
    """
    with h5py.File(path, "r") as file:
        field = (file[name][()] for name in ("points", "cells", "displacement"))
        return *field, Plan.from_json(file.attrs["executed"], path, case)
