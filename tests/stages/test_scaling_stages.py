"""What the stages cost, measured on one coarse patient: each in its own process, and what happens when one fails."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from pinnochio.columns import read_table
from pinnochio.experiments.measuring import DONE
from pinnochio.model.predictions import read_prediction
from pinnochio.networks.building import build
from pinnochio.tables.scaling import SCALING
from pinnochio.training.checkpoint import save_network
from studies.scaling.measure_scaling import measure_scaling, training_step, warm_plan
from tests.helpers.settings import CONFIG, SEED, network_settings, training_settings

NETWORK = network_settings(boundary_layers=1, volume_layers=2, channels=16, heads=2, neighbours=4)
TRAINING = vars(training_settings(steps=4, learning_rate=1e-3))


def input_files(patient) -> dict:
    return {
        name: getattr(patient, name)
        for name in ("labels", "bone", "skin", "report", "plan", "postop", "judged", "truth")
    }


def test_every_stage_has_a_row_with_its_cost(patient, tmp_path):
    settings = CONFIG | {"variants": {}}
    measure_scaling(patient.case, 600, input_files(patient), {}, settings, SEED, str(tmp_path / "600.csv"))
    rows = read_table(tmp_path / "600.csv", SCALING).set_index("stage")
    assert rows["unit"].to_dict() == {"tetrahedralize": "job", "label_interfaces": "job", "simulate_fem": "plan"}
    assert (rows["outcome"] == DONE).all() and (rows["target"] == 600).all()
    assert rows["nodes"].between(540, 660).all() and rows["memory"].between(100, 2000).all()
    assert (rows[["seconds", "cpu_seconds", "start_seconds", "written"]] > 0).all(None)
    assert [path.name for path in tmp_path.iterdir()] == ["600.csv"]


def test_a_stage_that_fails_and_those_that_need_it_say_so(patient, tmp_path):
    settings = CONFIG | {"variants": {"net": {"network": asdict(NETWORK)} | PHASES}}
    lacking = input_files(patient) | {"labels": str(tmp_path / "nowhere.nii.gz")}
    measure_scaling(patient.case, 600, lacking, {"net": "-"}, settings, SEED, str(tmp_path / "600.csv"))
    rows = read_table(tmp_path / "600.csv", SCALING).set_index("stage")
    assert rows.loc["tetrahedralize", "outcome"].startswith("failed: ")
    assert rows["outcome"].iloc[1:].to_dict() == {
        "label_interfaces": "not run: no mesh",
        "simulate_fem": "not run: no model",
        "pretrain net": "not run: no model",
        "predict_network net": "not run: no model",
        "evaluate": "not run: no model",
    }
    assert rows[["nodes", "seconds", "memory", "written"]].isna().all(None)


PHASES = {"pretraining": CONFIG["pretraining"] | {"steps": 1, "learning_rate": 1e-3}, "newton_corrections": 0}


@pytest.fixture
def arguments(patient) -> dict:
    return {"cases": [patient.case], "models": [patient.model], "lifts": []}


def test_a_step_is_timed_between_steps(patient, arguments, tmp_path):
    outputs = {"network": str(tmp_path / "network.pt"), "history": str(tmp_path / "history.csv")}
    settings = {"network": asdict(NETWORK), "pretraining": TRAINING, "fem": CONFIG["fem"]}
    seconds, cpu = training_step(
        **arguments, fem_samples=[patient.fem_samples], settings=settings, seed=SEED, outputs=outputs
    )
    assert seconds > 0 and cpu > 0 and Path(outputs["network"]).exists()
    assert len(Path(outputs["history"]).read_text().splitlines()) >= 1 + TRAINING["steps"]


def test_a_plan_is_timed_as_the_tables_have_it(patient, arguments, tmp_path):
    torch.manual_seed(0)
    save_network(tmp_path / "network.pt", build(NETWORK), NETWORK, training={}, seed=SEED)
    predictions = str(tmp_path / "predictions.h5")
    rest = {"plans": [patient.plan], "trained": str(tmp_path / "network.pt")}
    settings = {"fem": CONFIG["fem"], "newton_corrections": 0}
    seconds, cpu = warm_plan(**arguments, **rest, settings=settings, predictions=predictions)
    assert seconds == read_prediction(predictions, patient.case).seconds > 0 and np.isnan(cpu)
