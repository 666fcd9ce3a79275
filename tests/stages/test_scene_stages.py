"""From one coarse patient's model and plan to the scene's model, decisions, trials and table."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.mechanics.simulation import simulate
from pinnochio.model.patient import CUT_PLANE, PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.reduction.settings import REDUCTIONS
from pinnochio.tables.reductions import SCENES, TRIALS
from scripts.make_scene import make_scene
from scripts.measure_scene import measure_scene
from tests.helpers.settings import CONFIG, MESH, SEED, scene_settings
from tests.helpers.tables import make

LEFORT = "lefort1"


@pytest.fixture(scope="module")
def lefort(patient, tmp_path_factory):
    """The files of the patient with the LeFort part of the plan."""
    path = tmp_path_factory.mktemp("lefort") / "plan.json"
    Plan(patient.case, {LEFORT: Plan.read(patient.plan, patient.case).motions[LEFORT]}).write(path)
    return {name: getattr(patient, name) for name in ("model", "labels", "bone", "skin")} | {"plan": str(path)}


def test_scene_of_a_lefort_plan_is_smaller_and_its_face_moves_alike(patient, lefort, tmp_path):
    out = str(tmp_path / "scene.json"), str(tmp_path / "model.h5")
    make_scene(patient.case, lefort, CONFIG["interfaces"], patient.fem, scene_settings(), *out)
    said = json.loads(Path(out[0]).read_text())["plans"]["own"]
    assert set(said) == {"segments", *REDUCTIONS} and said["segments"]["value"] == [LEFORT]
    assert said["region"]["value"] and not said["bonded"]["value"] and not said["graded"]["value"]
    full, part = PatientModel.read(lefort["model"]), PatientModel.read(out[1])
    assert len(part.points) < 0.7 * len(full.points)
    np.testing.assert_array_equal(part.skin_points, full.skin_points)
    np.testing.assert_array_equal(part.face_roi, full.face_roi)
    assert (part.node_beyond == CUT_PLANE).sum() > 10
    plan = Plan.read(lefort["plan"], patient.case)
    faces = [model.moved_skin(simulate(model, plan, "mucosa", patient.fem).displacement) for model in (full, part)]
    judged = np.unique(full.skin_faces[full.face_roi])
    error = np.linalg.norm(faces[1] - faces[0], axis=1)[judged]
    moved = np.linalg.norm(faces[0] - full.skin_points, axis=1)[judged]
    # Voxels of 2 mm: the largest error is where the coarse reduced mesh ends.
    assert error.mean() < 0.1 * moved.mean() and error.max() < 0.3 * moved.max()


def test_trials_and_table_compare_every_reduction_with_the_full_model(patient, lefort, tmp_path):
    settings = replace(scene_settings(), graded=False)
    out = str(tmp_path / "trials.csv"), str(tmp_path / "scene.json")
    rest = MESH, CONFIG["interfaces"], patient.fem, settings, SEED, "code", *out
    measure_scene(patient.case, lefort, *rest)
    trials = read_table(out[0], TRIALS).set_index("model")
    assert list(trials.index) == ["full", *REDUCTIONS, "auto"] and trials["converged"].all()
    assert (trials.loc["full", ["error_mean", "error_max", "decide_seconds"]] == 0).all()
    assert (trials.drop("full")["error_mean"] > 0).all() and (trials["error_max"] >= trials["error_mean"]).all()
    assert trials.loc["region", "share"] < 0.7 and trials.loc["bonded", "share"] == 1
    assert trials.loc["auto", "share"] == trials.loc["region", "share"]
    assert trials.loc["bonded", "made"] == "bonded" and "region" in trials.loc["auto", "made"]
    assert list(json.loads(Path(out[1]).read_text())["plans"]) == [LEFORT]
    table = tmp_path / "scene.csv"
    make(table, "tables.reductions", trials=[out[0]], cohort="virtual cohort")
    assert read_table(table, SCENES)["model"].tolist() == list(trials.index)
    assert "virtual cohort" in table.with_suffix(".md").read_text()
