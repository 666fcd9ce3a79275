"""From one coarse patient and the parts of its plan to the trials, the table, and a prediction of what is required."""

from dataclasses import asdict

import numpy as np
import pytest

from pinnochio.columns import read_table
from pinnochio.mechanics.solvers.reduced import WORTH
from pinnochio.methods.finite_elements import FiniteElementPredictor
from pinnochio.methods.protocol import Planned
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.tables.reductions import SCENES, TRIALS
from studies.scene.measure_scene import measure_scene
from tests.helpers.settings import CONFIG, MESH, SEED
from tests.helpers.tables import make

LEFORT = "lefort1"
LIMIT = CONFIG["scene"]["amplitude"]


@pytest.fixture(scope="module")
def lefort(patient, tmp_path_factory):
    """The files of the patient with the LeFort part of the plan."""
    path = tmp_path_factory.mktemp("lefort") / "plan.json"
    Plan(patient.case, {LEFORT: Plan.read(patient.plan, patient.case).motions[LEFORT]}).write(path)
    return {name: getattr(patient, name) for name in ("model", "labels", "bone", "skin")} | {"plan": str(path)}


@pytest.fixture(scope="module")
def settings(patient):
    """What a method of sliding finite elements reads."""
    return {"fem": asdict(patient.fem), "contact": "mucosa"}


def test_a_lefort_plan_is_predicted_on_what_it_requires_alike(patient, lefort, settings, caplog):
    model, plan = PatientModel.read(lefort["model"]), Plan.read(lefort["plan"], patient.case)
    planned = Planned(patient.case, model, plan)
    caplog.set_level("INFO")
    whole = FiniteElementPredictor(settings, None, "cpu", 1)(planned)
    assert "of the cells are solved" not in caplog.text
    part = FiniteElementPredictor(settings | {"region": LIMIT}, None, "cpu", 1)(planned)
    said = [line for line in caplog.messages if "of the cells are solved" in line]
    assert said and 0 < int(said[-1].split()[1]) < 50
    assert whole.converged and part.converged and part.seconds > 0
    faces = [model.moved_skin(one.displacement)[model.judged_points] for one in (whole, part)]
    error = np.linalg.norm(faces[1] - faces[0], axis=1)
    assert 0 < error.mean() < 0.05 and error.max() < 0.3


def test_trials_and_table_compare_with_the_whole_patient(patient, lefort, settings, tmp_path):
    out, table = str(tmp_path / "trials.csv"), tmp_path / "scene.csv"
    config = {name: CONFIG[name] for name in ("interfaces", "fem_rlse", "scene")} | {"mesh": MESH}
    config["scene"] = config["scene"] | {"nodes": [MESH["nodes"], 1000]}
    config["fem_rlse"] = config["fem_rlse"] | {"lip_edge": 8}
    methods = {"fem_sliding": settings | {"mesh": "study"}, "fem_rlse_mucosa": settings | {"mesh": "lips"}}
    measure_scene(patient.case, lefort, config, methods, SEED, "code", out)
    trials = read_table(out, TRIALS)
    assert trials["model"].tolist() == ["full", "auto"] * 3 and set(trials["plan"]) == {LEFORT}
    assert trials["method"].tolist()[::2] == ["fem_sliding", "fem_sliding", "fem_rlse_mucosa"]
    assert trials["target"].tolist()[::2] == [MESH["nodes"], 1000, MESH["nodes"]]
    assert trials["converged"].all()
    full, auto = trials[trials["model"] == "full"], trials[trials["model"] == "auto"]
    assert (full[["error_mean", "error_max", "decide_seconds"]] == 0).all(axis=None) and (full["share"] == 1).all()
    assert (auto["share"] <= WORTH).all() and (auto["error_mean"] > 0).all() and (auto["error_max"] < 0.3).all()
    assert (trials[["mesh_seconds", "first_seconds", "further_seconds"]] > 0).all(axis=None)
    make(table, "tables.reductions", trials=[out], cohort="virtual cohort")
    assert read_table(table, SCENES)["target"].tolist() == [MESH["nodes"], 1000, MESH["nodes"]]
    assert "virtual cohort" in table.with_suffix(".md").read_text()
