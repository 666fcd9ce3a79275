"""Predictions made elsewhere become rows of a finished study, and nothing of it is made again."""

import csv
import re
import shutil

import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from pinnochio.model.predictions import read_prediction
from tests.helpers.study import jobs, made_tables

PREDICTOR = ["method", "device", "seconds", "setup_seconds", "threads", "reason", "code"]  # columns of who predicted


@pytest.fixture
def finished(studied, project):
    """A copy of the finished quick study."""
    for part in ("results", ".snakemake"):
        shutil.copytree(studied.folder / part, project.folder / part)
    return project


def test_predictions_of_others_get_the_rows_they_deserve(finished):
    """The fields of `fem_sliding`, delivered by somebody else in both formats, are measured as its own are."""
    results, rng = finished.folder / "results/quick", np.random.default_rng(0)
    elsewhere = finished.folder / "elsewhere"
    elsewhere.mkdir()
    finished.quick("--", "inputs")
    with open(results / "folds.csv") as file:
        folds = {row["case"]: row["fold"] for row in csv.DictReader(file)}
    for number, (case, fold) in enumerate(folds.items()):
        field = read_prediction(results / f"folds/{fold}/fem_sliding/predictions.h5", case).displacement
        if number % 2:
            np.savez(elsewhere / f"{case}.npz", displacement=field, seconds=1.5, setup_seconds=0.0)
            continue
        mesh = pv.read(results / f"cases/{case}/mesh.vtu")
        order = rng.permutation(mesh.n_points)
        cells = np.argsort(order)[mesh.cells_dict[pv.CellType.TETRA]]
        shuffled = pv.UnstructuredGrid({pv.CellType.TETRA: cells}, mesh.points[order])
        shuffled.point_data["displacement"] = field[order]
        shuffled.save(elsewhere / f"{case}.vtu")
    added = ("--config", "external={mine: elsewhere}")
    said = finished.quick(*added)
    assert made_tables(said) == {"cases", "accuracy", "regions", "landmarks", "stages"}
    made = {"predict_external": 2, "evaluate": 2, "tabulate": 5, "provenance": 1, "all": 1}
    assert jobs(said) == made
    cases = pd.read_csv(results / "tables/cases.csv").set_index("case")
    rows = {method: part.drop(columns=PREDICTOR) for method, part in cases.groupby("method")}
    assert len(rows["fem_sliding"]) == 4
    assert (cases[cases["method"] == "mine"].loc[list(folds)[1::2], "seconds"] == 1.5).all()
    pd.testing.assert_frame_equal(rows["mine"], rows["fem_sliding"])
    accuracy = pd.read_csv(results / "tables/accuracy.csv").set_index("method")
    compared = ["n", "failed", "cd_mean", "hd95_sd", "pwr1_mean", "skin_error_mean_mean"]
    theirs, solved = (accuracy.loc[[method], compared].to_numpy(float) for method in ("mine", "fem_sliding"))
    np.testing.assert_array_equal(theirs, solved)
    # A new prediction of one patient is measured anew, with its fold alone.
    np.savez(elsewhere / f"{case}.npz", displacement=0 * field)
    said = finished.planned(*added)
    assert re.findall(r"Read what (\w+) predicts for fold (\d)", said) == [("mine", fold)]
