"""New patients after the quick study: two plans share what belongs to the patient, and nothing is ever trained."""

import json
import shutil

import pytest

from tests.helpers.study import jobs

METHOD = "pinnochio_plus"
SHARED = ("import_segmentation", "tetrahedralize", "label_interfaces", "report_quality", "make_lift")
TRAINING = {"pretrain", "finetune", "simulate_fem", "calibrate", "describe_training", "pack", "virtual_patient"}


@pytest.fixture(scope="module")
def clinic(packed, tmp_path_factory):
    """A project with that archive and nothing else of a study, and a patient with two plans: V01, renamed."""
    project = type(packed)(tmp_path_factory.mktemp("clinic"))
    shutil.copytree(packed.folder / "results/quick/archive", project.folder / "packed")
    patient = project.folder / "P01"
    (patient / "plans").mkdir(parents=True)
    virtual = packed.folder / "results/quick/virtual/V01"
    shutil.copy(virtual / "segmentation.nii.gz", patient)
    plan = json.loads((virtual / "plan.json").read_text()) | {"case": "P01"}
    (patient / "plans/treat.json").write_text(json.dumps(plan))
    plan["segments"]["mandible_distal"]["translation"] = [0, 40, 0]
    plan["case"] = "V01"  # not the folder's name
    (patient / "plans/extreme.json").write_text(json.dumps(plan))
    return project


def predict(project, *config):
    return project.snakemake("--configfile", "config/quick.yaml", "--config", "patient=P01", *config, "--", "predict")


def test_an_archive_alone_predicts_two_plans_of_one_patient(clinic):
    done = predict(clinic, "models=packed")
    assert done.returncode == 0, done.stdout[-4000:]
    made = jobs(done.stdout)
    assert {name: made[name] for name in SHARED} == dict.fromkeys(SHARED, 1)
    assert {made[name] for name in ("import_plan", "predict_ensemble", "predict_interval", "certify")} == {2}
    assert "P01/plans/extreme.json names case 'V01'" in done.stdout.split("import_segmentation")[0]  # before any job
    assert not made.keys() & TRAINING
    results = clinic.folder / "results/quick"
    assert {path.name for path in results.iterdir()} == {"patients", "logs", "benchmarks"}
    said = {}
    for plan in ("treat", "extreme"):
        folder = results / f"patients/P01/{plan}/{METHOD}"
        said[plan] = json.loads((folder / "certificate.json").read_text())
        assert said[plan]["measures"]["inverted"] == 0 and said[plan]["interval"]["median_mm"] > 0
        assert (folder / "index.html").stat().st_size > 200_000
        for name in ("measures.csv", "deformed.vtu", "skin.ply", "skin.stl", "skin.vtp", "bones/lefort1.stl"):
            assert (folder / name).stat().st_size > 1000
    together = (results / f"patients/P01/plans_{METHOD}.html").read_text()
    assert "extreme" in together and "set back 40.0 mm" in together and "Plotly" in together
    assert said["treat"]["in_distribution"]["within"]  # it is one of the training
    # Six patients with as many operations leave a wide norm; what lies outside their range is named all the same.
    assert not said["treat"]["in_distribution"]["plan"]["outside"]
    assert said["extreme"]["in_distribution"]["plan"]["outside"]
    assert said["extreme"]["in_distribution"]["anatomy"]["within"]
    # Beyond what the stability sweep finds good: certificate and page say so.
    assert said["extreme"]["measures"]["motion_mm"] > 35 and said["treat"]["measures"]["motion_mm"] < 20
    assert said["extreme"]["verdict"]["grade"] == "not usable"
    page = (results / f"patients/P01/extreme/{METHOD}/index.html").read_text()
    assert "<b>Not usable." in page and "Motion of the bones" in page
    assert "Nothing to be done" in predict(clinic, "models=packed").stdout


def test_a_plan_that_is_added_later_shares_the_patient(clinic):
    predict(clinic, "models=packed")
    plan = clinic.folder / "P01/plans/treat.json"
    shutil.copy(plan, plan.with_name("again.json"))
    done = predict(clinic, "models=packed", "predict={method: elastic}")
    plan.with_name("again.json").unlink()
    assert done.returncode == 0, done.stdout[-4000:]
    made = jobs(done.stdout)
    assert made.pop("predict_cases") == 3 and made.pop("import_plan") == 1 and made.pop("check_patient") == 1
    assert not made.keys() & {*SHARED, *TRAINING}
    folder = clinic.folder / "results/quick/patients/P01/again/elastic"
    assert json.loads((folder / "certificate.json").read_text())["in_distribution"] is None


def test_without_models_a_prediction_is_refused_before_anything_is_made(clinic):
    done = predict(clinic)
    assert done.returncode != 0
    for words in ("there is no archive of trained models", "snakemake archive", "'models'", "Remedy: "):
        assert words in done.stdout, done.stdout[-2000:]


def test_outdated_files_of_the_study_train_nothing(packed, clinic):
    """The archive lies where the study left it, and what the networks were trained on is newer than they are."""
    for path in (packed.folder / "results/quick/cases").rglob("*.h5"):
        path.touch()
    shutil.copytree(clinic.folder / "P01", packed.folder / "P01")
    assert jobs(packed.planned("--", "archive")).keys() & TRAINING
    assert not jobs(packed.planned("--config", "patient=P01", "--", "predict")).keys() & TRAINING
