"""The bounds: they know what happened, and nothing else does."""

import h5py
import numpy as np
import pytest

from pinnochio.code import closure, source_file
from pinnochio.errors import InputError
from pinnochio.methods.floor_scan import ScanFloorPredictor
from pinnochio.methods.protocol import Planned
from pinnochio.methods.registry import registry
from pinnochio.metrics.chamfer import surface_metrics
from pinnochio.metrics.judged import choose
from pinnochio.study.configuration import check_config
from pinnochio.study.inputs.prediction import PredictionInputs
from pinnochio.study.inputs.rules import RuleInputs
from pinnochio.study.study import Study
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import CONFIG

BOUNDS = ["floor_scan", "oracle_learner", "oracle"]


def truth_file(path, patient, displacement):
    """A file of the virtual truth, as the outcome writes it."""
    with h5py.File(path, "w") as file:
        file["points"], file["cells"], file["displacement"] = patient.points, patient.cells, displacement
        file.attrs["executed"] = tiny_plan().to_json()
    return str(path)


def test_the_true_skin_against_a_scan_without_noise_is_nothing_off(tmp_path):
    patient = tiny_patient()
    true = patient.points @ np.array([[0.02, 0, 0], [0, -0.01, 0.03], [0.01, 0, 0]]) + [0, -3.0, 1.0]
    planned = Planned("tiny", patient, tiny_plan(), truth=truth_file(tmp_path / "truth.h5", patient, true))
    prediction = ScanFloorPredictor({}, None, "cpu", 1)(planned)
    assert prediction.displacement is None and np.isnan(prediction.seconds)
    moved, scan = prediction.moved_skin(patient), patient.moved_skin(true)
    assert np.allclose(moved, scan, atol=1e-9)
    judged = choose(patient, tiny_plan(), scan, patient.skin_faces, 500, 1)
    values = surface_metrics(
        moved, patient.skin_faces, judged.before(patient).carried(moved), scan, patient.skin_faces, judged.target
    )
    assert values["hdmax"] < 1e-9 and values["pwr1"] == 100


def test_no_method_but_the_bounds_reads_the_truth():
    """Neither by its files, which reach one job each, nor by its code."""
    made, truth = Study.of(CONFIG), source_file("pinnochio.model.truth")
    for name, method in made.methods.registry.items():
        if name not in made.methods.used:
            continue
        batch = PredictionInputs(made).batch("folds/1", name)
        files = [*batch.truths, *batch.executed]
        assert not any("virtual/" in folder for folders in batch.folders.values() for folder in folders)
        secret = {file.split("/")[-1] for file in files if "virtual/" in file}
        assert secret == {"floor_scan": {"truth.h5"}, "oracle_learner": {"truth.h5"}, "oracle": {"executed.json"}}.get(
            name, set()
        ), name
        assert (truth in closure(source_file(method.predictor))) == (name in ("floor_scan", "oracle_learner")), name
        if method.learner:
            assert truth not in closure(source_file(method.learner)), name
    training = [f"training.{name}" for name in ("fit", "pretrain", "finetune")]
    for stage in (*training, "prediction.predict", "fem.simulate_fem"):
        assert truth not in closure(source_file(f"scripts.{stage}")), stage


def test_bounds_are_predicted_and_never_compared_with():
    made = Study.of(CONFIG)
    assert made.methods.bounds == BOUNDS and not set(BOUNDS) & set(made.methods.compared)
    assert set(made.methods.compared) | set(BOUNDS) == set(made.methods.used)
    inputs = RuleInputs(made)
    for others in (inputs.patients.packed, made.methods.learned, inputs.report.volumes):
        assert not set(BOUNDS) & set(others)
    assert not any(registry(CONFIG)[name].new_patients for name in BOUNDS)
    plain, oracle = (registry(CONFIG)[name] for name in ("fem_sliding", "oracle"))
    assert (plain.predictor, plain.settings) == (oracle.predictor, oracle.settings)


@pytest.mark.parametrize("bound", BOUNDS)
def test_a_bound_is_no_reference(bound):
    with pytest.raises(InputError, match=f"reference '{bound}' is a bound"):
        check_config(CONFIG | {"reference": bound})
