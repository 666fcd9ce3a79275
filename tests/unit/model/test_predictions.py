"""Predictions made elsewhere: both file formats, any order of the nodes, and what is refused."""

import numpy as np
import pytest
import pyvista as pv

from pinnochio.errors import InputError
from pinnochio.model.predictions import Prediction, read_external, read_prediction, write_predictions
from pinnochio.study.inputs.prediction import external_file

# Two tetrahedra that face each other across a closed slit: nodes 0-2 and 4-6 share their places.
TOP = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [3, 3, 10]])
POINTS = np.concatenate([TOP, TOP * [1, 1, -1]])
CELLS = np.array([[0, 1, 2, 3], [4, 6, 5, 7]])
FIELD = np.arange(24.0).reshape(8, 3)


def write_vtu(path, points=POINTS, cells=CELLS, field=FIELD, order=None, **scalars):
    """The mesh and its field with the nodes in `order`."""
    order = np.arange(len(points)) if order is None else np.asarray(order)
    place = np.argsort(order)
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: place[cells]}, points[order])
    grid.point_data["displacement"] = field[order]
    for name, value in scalars.items():
        grid.field_data[name] = [value]
    grid.save(path)
    return path


def write_npz(path, **arrays):
    np.savez(path, **arrays)
    return path


def read(path):
    return read_external(path, "P1", POINTS, CELLS)


def test_npz_is_read_in_the_order_of_the_mesh(tmp_path):
    prediction = read(write_npz(tmp_path / "P1.npz", displacement=FIELD, seconds=2.5))
    np.testing.assert_array_equal(prediction.displacement, FIELD)
    assert (prediction.seconds, prediction.device, prediction.threads, prediction.converged) == (
        2.5,
        "external",
        0,
        True,
    )
    assert np.isnan(prediction.setup_seconds)
    write_predictions(tmp_path / "predictions.h5", {"P1": prediction})
    back = read_prediction(tmp_path / "predictions.h5", "P1")
    np.testing.assert_array_equal(back.displacement, FIELD)
    assert back.seconds == 2.5 and np.isnan(back.setup_seconds) and back.device == "external"


def test_a_networks_prediction_keeps_its_interface_and_what_the_inversion_repair_did(tmp_path):
    prediction = Prediction(FIELD, boundary=2 * FIELD, raw=3 * FIELD, repaired=40, damping=1.0)
    write_predictions(tmp_path / "predictions.h5", {"P1": prediction, "P2": Prediction(FIELD)})
    back, bare = (read_prediction(tmp_path / "predictions.h5", case) for case in ("P1", "P2"))
    np.testing.assert_array_equal(back.boundary, 2 * FIELD)
    np.testing.assert_array_equal(back.raw, 3 * FIELD)
    assert (back.repaired, back.damping) == (40, 1)
    assert bare.boundary is None and bare.raw is None
    assert np.isnan([bare.repaired, bare.damping]).all()


@pytest.mark.parametrize("seed", range(6))
def test_vtu_is_matched_by_position_even_across_a_closed_slit(tmp_path, seed):
    order = np.random.default_rng(seed).permutation(8)
    prediction = read(write_vtu(tmp_path / "P1.vtu", order=order, setup_seconds=4.0))
    np.testing.assert_array_equal(prediction.displacement, FIELD)
    assert prediction.setup_seconds == 4 and np.isnan(prediction.seconds)


def test_vtu_in_single_precision_and_in_order_needs_no_cells(tmp_path):
    cloud = pv.UnstructuredGrid({pv.CellType.VERTEX: np.arange(8)[:, None]}, POINTS.astype(np.float32) + 5e-4)
    cloud.point_data["displacement"] = FIELD
    cloud.save(tmp_path / "P1.vtu")
    np.testing.assert_array_equal(read(tmp_path / "P1.vtu").displacement, FIELD)


def test_npz_comes_before_vtu_and_a_missing_file_names_both(tmp_path):
    with pytest.raises(InputError, match=f"'P1'.*{tmp_path}.*P1.npz nor P1.vtu.*Remedy"):
        external_file(tmp_path, "P1")
    assert external_file(write_vtu(tmp_path / "P1.vtu").parent, "P1") == str(tmp_path / "P1.vtu")
    assert external_file(write_npz(tmp_path / "P1.npz").parent, "P1") == str(tmp_path / "P1.npz")


def with_nan():
    field = FIELD.copy()
    field[3, 1] = np.nan
    return field


@pytest.mark.parametrize(
    ("arrays", "problem"),
    [
        ({"moved": FIELD}, "no numbers named 'displacement'"),
        ({"displacement": FIELD[:5]}, r"\(5, 3\), the mesh has 8 nodes"),
        ({"displacement": FIELD.T}, r"\(3, 8\), the mesh has 8 nodes"),
        ({"displacement": with_nan()}, "1 nodes is not finite"),
        ({"displacement": FIELD.astype(str)}, "no numbers named"),
        ({"displacement": FIELD.astype(object)}, "cannot be read"),
        ({"displacement": FIELD, "seconds": -1.0}, "seconds is not one number"),
        ({"displacement": FIELD, "setup_seconds": [1.0, 2.0]}, "setup_seconds is not one number"),
    ],
)
def test_a_bad_npz_is_refused(tmp_path, arrays, problem):
    with pytest.raises(InputError, match=rf"'P1'.*P1\.npz.*{problem}.*Remedy"):
        read(write_npz(tmp_path / "P1.npz", **arrays))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"points": POINTS + [0, 0, 0.01]}, "its 8 points are not the 8 nodes"),
        ({"points": POINTS + [0, 0, 0.01], "order": [7, 6, 5, 4, 3, 2, 1, 0]}, "are not the 8 nodes"),
        ({"points": POINTS[:4], "cells": CELLS[:1], "field": FIELD[:4]}, "its 4 points are not the 8 nodes"),
        # Reordered, and the two sides of the slit are no longer to be distinguished.
        ({"cells": CELLS[:1], "order": [1, 0, 2, 3, 4, 5, 6, 7]}, "are not the 8 nodes"),
        ({"cells": CELLS[:, [0, 0, 0, 0]], "order": [4, 1, 2, 3, 0, 5, 6, 7]}, "are not the 8 nodes"),
        ({"field": with_nan()}, "not finite"),
        ({"field": FIELD[:, :2]}, r"\(8, 2\)"),
    ],
)
def test_a_bad_vtu_is_refused(tmp_path, change, problem):
    with pytest.raises(InputError, match=rf"'P1'.*P1\.vtu.*{problem}.*Remedy"):
        read(write_vtu(tmp_path / "P1.vtu", **change))


@pytest.mark.filterwarnings("ignore:The VTK reader")
@pytest.mark.parametrize("name", ["P1.npz", "P1.vtu"])
def test_a_file_that_is_none_is_refused(tmp_path, name):
    (tmp_path / name).write_text("nothing of the kind")
    with pytest.raises(InputError, match=f"'P1'.*{name}"):
        read(tmp_path / name)
