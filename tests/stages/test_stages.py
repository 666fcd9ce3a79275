"""Each stage's function, on the files of one coarse virtual patient."""

import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pinnochio.mechanics.boundary.conditions import boundary_conditions
from pinnochio.mechanics.boundary.contact import UnilateralContact
from pinnochio.mechanics.elements.tetrahedra import jacobians
from pinnochio.meshing.mesh import TetMesh
from pinnochio.methods.pinnochio.predictor import load_network
from pinnochio.model.patient import FIXED, LOWER_LIP, MOVING, SLIDING, UPPER_LIP, PatientModel
from pinnochio.model.predictions import read_prediction
from pinnochio.plans.plan import Plan
from pinnochio.virtual.head import USUAL
from scripts.cohort.render_faces import PANEL, render_faces
from scripts.fem.solve_plan import solve_plan
from scripts.patient.check_cohort import check_cohort
from scripts.patient.label_interfaces import label_case
from scripts.patient.model_lips import refine_lips
from scripts.training.finetune import finetune
from scripts.training.pretrain import pretrain
from tests.helpers.coarse_head import make_head
from tests.helpers.settings import CONFIG, SEED, SEGMENTS, network_settings, training_settings
from tests.helpers.tables import make
from tests.helpers.training import measured, predict_by

NETWORK = network_settings(boundary_layers=1, volume_layers=2, channels=16, heads=2, neighbours=4)


def test_virtual_patient_is_its_seed(patient, tmp_path):
    names = {"segmentation": "segmentation.nii.gz", "plan": "input_plan.json"}
    names |= {"landmarks": "landmarks.json", "anatomy": "anatomy.json"}
    again = {key: str(tmp_path / name) for key, name in names.items()}
    rest = CONFIG["labels"], USUAL, again
    make_head(patient.case, 0, SEED, 2.0, *rest)
    for name in names.values():
        assert (tmp_path / name).read_bytes() == (patient.folder / name).read_bytes()
    make_head(patient.case, 0, SEED + 1, 2.0, *rest)
    assert (tmp_path / "input_plan.json").read_bytes() != (patient.folder / "input_plan.json").read_bytes()


def test_a_contact_sheet_shows_six_panels_a_patient_and_the_outcome_differs(patients, tmp_path):
    one, two = patients
    files = [[str(p.folder / name) for p in (one, two)] for name in ("model.h5", "true_motion.h5", "anatomy.json")]
    sheet = tmp_path / "faces.png"
    render_faces([one.case, two.case], *files, str(sheet))
    width, height = PANEL
    pixels = np.asarray(Image.open(sheet)).astype(int)
    assert pixels.shape == (height, 2 * 6 * width, 3)
    panels = np.split(pixels, 12, axis=1)
    assert all((panel < 250).mean() > 0.1 for panel in panels)
    for first in (0, 6):
        upper = slice(height // 8, height // 2)  # below the words
        assert np.abs(panels[first][upper] - panels[first + 4][upper]).mean() < 5  # stays
        assert np.abs(panels[first + 1] - panels[first + 5]).max() > 30
    assert np.abs(panels[0] - panels[6]).mean() > 1


def test_the_outcome_is_not_what_the_methods_compute(patient):
    """Other mesh, other motion: executed with error, then the scan lies in a frame of its own."""
    model = PatientModel.read(patient.model)
    with h5py.File(patient.truth) as truth, h5py.File(patient.postop) as postop:
        assert len(truth["points"]) > 1.2 * len(model.points)
        ratio = jacobians(truth["points"][()], truth["cells"][()], truth["displacement"][()])
        assert ratio.min() > 0
        assert postop.attrs["registration_residual"] < 0.6
        assert len(postop["points"]) > 500


def test_import_reports_every_structure(patient, tmp_path):
    table = tmp_path / "cohort.csv"
    check_cohort([patient.case], [patient.report], str(table))
    row = pd.read_csv(table).iloc[0]
    assert row["case"] == patient.case and row["muscle_cm3"] > 30 and row["superficial_cm3"] > row["muscle_cm3"]
    assert (row[[f"{segment}_cm3" for segment in SEGMENTS]] > 3).all()


def test_the_mesh_that_resolves_the_lips(patient, tmp_path):
    """More nodes on the lips, the same tissue, every arm solved; lips in contact enter each other less than apart."""
    made = {name: str(tmp_path / name) for name in ("mesh.vtu", "model.h5")}
    refine_lips(patient.mesh, patient.labels, patient.bone, 18.0, 5.0, made["mesh.vtu"])
    coarse, fine = TetMesh.read(patient.mesh), TetMesh.read(made["mesh.vtu"])
    assert np.array_equal(fine.points[: len(coarse.points)], coarse.points)
    assert 1.2 * len(coarse.points) < len(fine.points) < 10 * len(coarse.points)
    assert fine.volumes().sum() == pytest.approx(coarse.volumes().sum(), rel=1e-12)
    rest = patient.report, CONFIG["interfaces"], made["model.h5"]
    label_case(made["mesh.vtu"], patient.labels, patient.bone, patient.skin, *rest)
    before, model = PatientModel.read(patient.model), PatientModel.read(made["model.h5"])
    for lip in (UPPER_LIP, LOWER_LIP):
        assert (model.lip == lip).sum() > (before.lip == lip).sum()
    fields = {}
    for arm in ("bonded", "mucosa", "mucosa+lip"):
        file = str(tmp_path / "predictions.h5")
        settings = {"fem": CONFIG["fem"], "contact": arm}
        predict_by("finite_elements:FiniteElementPredictor", patient, file, made["model.h5"], **settings)
        fields[arm] = read_prediction(file, patient.case)
        assert fields[arm].converged, (arm, fields[arm].reason)
    contact = boundary_conditions(model, Plan.read(patient.plan, patient.case), "mucosa+lip").contact
    gaps = UnilateralContact(model.points, contact, 1.0).gaps
    assert gaps(fields["mucosa+lip"].displacement).min() > min(-0.3, gaps(fields["mucosa"].displacement).min() / 2)
    # Nowhere to refine: the mesh it was.
    refine_lips(patient.mesh, patient.labels, patient.bone, 0.0, 5.0, made["mesh.vtu"])
    assert Path(made["mesh.vtu"]).read_bytes() == Path(patient.mesh).read_bytes()


def test_interfaces_know_their_bone(patient):
    model = PatientModel.read(patient.model)
    assert all((model.node_type == kind).sum() > 5 for kind in (FIXED, MOVING, SLIDING))
    cue, reliable = model.reference_cue(Plan.read(patient.plan, patient.case))
    assert (cue[model.node_type == FIXED] == 0).all() and not reliable[model.node_type == SLIDING].any()
    assert np.linalg.norm(cue[model.node_type == MOVING], axis=1).max() > 1
    assert len(model.skin_points) > 3 * len(np.unique(model.skin_nodes)) and model.face_roi.mean() > 0.2


def test_fem_samples_follow_their_plans(patient):
    model = PatientModel.read(patient.model)
    with h5py.File(patient.fem_samples) as file:
        assert sorted(file) == ["plan_0", "plan_1"]
        for group in file.values():
            plan = Plan.from_json(group.attrs["plan"])
            cue, reliable = model.reference_cue(plan)
            np.testing.assert_allclose(group["displacement"][()][reliable], cue[reliable], atol=1e-9)
            assert group.attrs["min_jacobian"] > 0


def test_solve_plan_leaves_field_summary_and_picture(patient, tmp_path):
    outputs = [str(tmp_path / name) for name in ("field.vtu", "summary.json", "picture.png")]
    solve_plan(patient.case, patient.model, patient.plan, "bonded", patient.fem, *outputs)
    said = json.loads(Path(outputs[1]).read_text())
    assert said["converged"] and said["inverted"] == 0 and said["relative_residual"] <= patient.fem.tolerance
    assert Path(outputs[2]).stat().st_size > 10_000
    with pytest.raises(RuntimeError, match="time limit"):
        solve_plan(patient.case, patient.model, patient.plan, "bonded", replace(patient.fem, time_limit=1e-9), *outputs)


@pytest.fixture(scope="session")
def predicted(patients, tmp_path_factory) -> dict[str, str]:
    """A network trained on the second patient, and every method's prediction of the first."""
    folder = tmp_path_factory.mktemp("fold")
    one, two = patients
    phase, fem = vars(training_settings(steps=15, learning_rate=2e-3)), CONFIG["fem"]
    common = {
        "learner": "pinnochio.methods.pinnochio.learner:GraphLearner",
        "settings": {"network": asdict(NETWORK), "pretraining": phase, "finetuning": phase, "fem": fem},
        **{"cases": [two.case], "models": [two.model], "lifts": [], "seed": SEED, "code": "x", "device": "cpu"},
    }
    first = {"network": str(folder / "pretrained.pt"), "history": str(folder / "pretraining.csv")}
    pretrain(**common, fem_samples=[two.fem_samples], outputs=first)
    last = {"network": str(folder / "network.pt"), "history": str(folder / "finetuning.csv")}
    finetune(**common, plans=[two.plan], postops=[two.postop], covariates=[], pretrained=first["network"], outputs=last)
    files = {method: str(folder / f"{method}.h5") for method in ("no_change", "fem_sliding", "pinnochio")}
    predict_by("no_change:NoChangePredictor", one, files["no_change"])
    predict_by("finite_elements:FiniteElementPredictor", one, files["fem_sliding"], fem=fem, contact="mucosa")
    network = {"trained": last["network"], "fem": fem, "newton_corrections": 0}
    predict_by("pinnochio.predictor:GraphPredictor", one, files["pinnochio"], **network)
    return files


def test_predictions_say_what_they_are(predicted, patient):
    """Nothing moves; finite elements are solved; a network's field leaves with no inverted element."""
    still, solved, learned = (
        read_prediction(predicted[name], patient.case) for name in ("no_change", "fem_sliding", "pinnochio")
    )
    model = PatientModel.read(patient.model)
    assert not still.displacement.any() and solved.converged and solved.seconds > 0
    assert jacobians(model.points, model.cells, learned.displacement).min() > 0 and learned.seconds > 0
    assert 1 < np.linalg.norm(learned.displacement, axis=1).max() < 30


def test_tables_come_from_the_metrics(predicted, patient, tmp_path):
    metrics = []
    for method, path in predicted.items():
        metrics.append(str(tmp_path / f"{method}.csv"))
        measured(patient, path, metrics[-1], method)
    make(tmp_path / "cases.csv", "pinnochio.tables.cases", metrics=metrics, cohort="virtual cohort")
    compared = {"cases": tmp_path / "cases.csv", "methods": list(predicted), "bounds": [], "reference": "pinnochio"}
    compared |= {"cohort": "virtual cohort", "seed": SEED}
    make(tmp_path / "accuracy.csv", "pinnochio.tables.accuracy", published=True, **compared)
    cases = pd.read_csv(tmp_path / "cases.csv").set_index("method")
    assert cases.loc["fem_sliding", "cd"] < cases.loc["no_change", "cd"]
    assert cases.loc["fem_sliding", "eqres_rel"] < 1e-5 < cases.loc["pinnochio", "eqres_rel"]
    assert cases.loc["fem_sliding", "moving_error"] < 1e-6 < cases.loc["no_change", "moving_error"]
    accuracy = pd.read_csv(tmp_path / "accuracy.csv", keep_default_na=False)
    assert list(accuracy["method"]) == list(predicted) and (accuracy["p"] == "").all()
    text = (tmp_path / "accuracy.md").read_text()
    assert "virtual cohort" in text and "Other patients, scans and machines than above" in text
    for kind, count in (("regions", 7), ("landmarks", 13)):
        path = tmp_path / f"{kind}.csv"
        make(path, f"pinnochio.tables.{kind}", **compared)
        places = pd.read_csv(path, keep_default_na=False)
        assert len(places) == count * len(predicted) and (places["n"] == 1).all()
        assert (places.loc[~places["reference"], "test"] == "n = 1 < 6: not tested").all()
        means = places.astype({"mean": float}).pivot(index="method", columns="place", values="mean")
        assert (means > 0).all(None)
    assert (cases["bias_chin"].abs() <= cases["region_chin"] + 1e-4).all()
    pd.testing.assert_series_equal(means["skin"], cases["skin_error_mean"].sort_index(), check_names=False, atol=1e-4)


def test_the_cost_is_read_from_networks_and_benchmark_files(predicted, tmp_path):
    folder = Path(predicted["pinnochio"]).parent
    files = [str(folder / "network.pt")]
    curves = [str(folder / f"{name}.csv") for name in ("pretraining", "finetuning")]
    for rule, seconds in (("pretrain", 12.5), ("finetune", 2.5)):
        folder = tmp_path / "benchmarks" / rule
        folder.mkdir(parents=True)
        (folder / "1_pinnochio.tsv").write_text(f"s\tmax_rss\tcpu_time\n{seconds}\t300\tNA\n")
    phases = dict.fromkeys(("pretraining", "finetuning"), vars(training_settings(steps=15, learning_rate=2e-3)))
    training, stages = tmp_path / "training.csv", tmp_path / "stages.csv"
    measured = {"benchmarks": tmp_path / "benchmarks", "cohort": "virtual cohort"}
    about = {"settings": {"pinnochio": phases}, "folds": ["1"], "rule": CONFIG["convergence"]}
    make(training, "pinnochio.tables.training", networks=files, histories=curves, **about, **measured)
    row = pd.read_csv(training).loc[0]
    network, _ = load_network(files[0])
    assert row["parameters"] == sum(value.numel() for value in network.parameters())
    assert (row["pretraining_samples"], row["pretraining_seconds"], row["finetuning_seconds"]) == (15, 12.5, 2.5)
    make(stages, "pinnochio.tables.stages", **measured)
    assert pd.read_csv(stages)["seconds"].tolist() == [12.5, 2.5, 15.0]


def test_log_holds_what_was_said_and_raised(tmp_path):
    log = tmp_path / "stage.log"
    code = f"from pinnochio.logs import attach_log; attach_log({str(log)!r})\nimport logging, warnings\n"
    code += "logging.info('began'); warnings.warn('odd'); raise ValueError('the end')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": ":".join(sys.path)},
        check=False,
    )
    text = log.read_text()
    assert done.returncode == 1 and "ValueError: the end" in done.stderr
    assert "began" in text and "odd" in text and "the end" in text
