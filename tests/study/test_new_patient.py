"""New patients, after the quick study and by the models that come along: plans share a patient, nothing is trained."""

import json
import os
import re
import shutil
import subprocess
import sys

import pytest

from tests.helpers.settings import ROOT
from tests.helpers.study import Project, jobs

METHOD, QUICK = "pinnochio_plus", ("--configfile", "config/quick.yaml")
SHARED = ("import_segmentation", "model_patient", "show_quality")
TRAINING = {"pretrain", "finetune", "model_case", "calibrate", "describe_training", "pack", "virtual_patient"}


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


def planned(project, *config):
    return project.planned("--config", "patient=P01", *config, "--", "predict")


def at_once(project, *words) -> str:
    """What the one process says that predicts without Snakemake, as `make predict` does."""
    command = [sys.executable, "workflow/predict.py", *words]
    done = subprocess.run(command, cwd=project.folder, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def predicted(clinic) -> str:
    """What is said when both plans are predicted by that archive."""
    return clinic.quick("--config", "patient=P01", "models=packed", "--", "predict")


def test_an_archive_alone_predicts_two_plans_of_one_patient(clinic, predicted):
    made = jobs(predicted)
    assert {name: made[name] for name in SHARED} == dict.fromkeys(SHARED, 1)
    assert {made[name] for name in ("import_plan", "predict_plan")} == {2}
    assert "P01/plans/extreme.json names case 'V01'" in predicted.split("import_segmentation")[0]  # before any job
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
    assert "Nothing to be done" in planned(clinic, "models=packed")


def test_a_plan_that_is_added_later_shares_the_patient(clinic, predicted):
    plan = clinic.folder / "P01/plans/treat.json"
    shutil.copy(plan, plan.with_name("again.json"))
    made = jobs(planned(clinic, "models=packed"))
    other = jobs(planned(clinic, "models=packed", "predict={method: elastic}"))
    plan.with_name("again.json").unlink()
    assert made.pop("predict_plan") == 1 and other.pop("predict_plan") == 3
    for counted in (made, other):
        assert counted["import_plan"] == counted["check_patient"] == 1 and not counted.keys() & {*SHARED, *TRAINING}


def test_an_older_plan_in_place_of_a_newer_one_is_imported(clinic, predicted):
    plan = clinic.folder / "P01/plans/treat.json"
    content, when = plan.read_bytes(), plan.stat().st_mtime
    plan.write_bytes(content + b"\n")
    os.utime(plan, (when - 1e6, when - 1e6))
    made = jobs(planned(clinic, "models=packed"))
    plan.write_bytes(content)
    os.utime(plan, (when, when))
    assert made["import_plan"] == 1 and not made.keys() & {*SHARED, *TRAINING}


def test_without_models_a_prediction_is_refused_before_anything_is_made(clinic):
    done = clinic.snakemake(*QUICK, "--config", "patient=P01", "--", "predict")
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


def test_the_example_patient_is_predicted_right_away(tmp_path):
    project = Project(tmp_path)
    shutil.copytree(ROOT / "models", project.folder / "models")
    done = at_once(project, "patient=examples/P01")
    assert "trained on 40 patients (virtual cohort (development))" in done.splitlines()[0]
    dry = project.dry_run("--config", "patient=examples/P01", "--", "predict")
    assert dry.returncode == 0 and "Nothing to be done" in dry.stdout
    (folder,) = (project.folder / "results/patients/P01").glob("*/pinnochio_plus")
    said = json.loads((folder / "certificate.json").read_text())
    assert said["interval"]["level"] == 0.9 and said["interval"]["patients"] == 40
    assert said["in_distribution"]["within"] and said["measures"]["inverted"] == 0
    assert said["verdict"]["grade"] in ("usable", "with care")
    assert said["measures"]["skin_max_mm"] > 2
    assert 0 < said["measures"]["load_rel"] < 1  # the residual is that of the field under its own load
    assert (folder / "index.html").stat().st_size > 200_000


def test_one_process_keeps_what_the_rules_made(clinic, predicted):
    words, folder = ("patient=P01", "models=packed", *QUICK), clinic.folder / "results/quick"
    said = at_once(clinic, *words).splitlines()[-1]
    assert said.endswith(f"results/quick/patients/P01/plans_{METHOD}.html") and "extreme" in said
    log = (folder / "logs/predict/P01.log").read_text()
    again = set(re.findall(r"root: (\w+) .*: [\d.]+ s$", log, re.M))
    assert log.count(": kept") > 12 and again <= {"check_cohort", "show_segments", "show_quality"}
    shutil.rmtree(folder / f"patients/P01/treat/{METHOD}")
    at_once(clinic, *words)
    log = (folder / "logs/predict/P01.log").read_text()
    assert "predict ensemble.h5: kept" in log and re.search(r"export_prediction .*: [\d.]+ s$", log, re.M)


@pytest.mark.full
@pytest.mark.parametrize("head", ["artisynth", "headsq"])
def test_a_real_head_is_predicted_and_called_unlike_the_training(request, packed, head):
    project = request.getfixturevalue(head)
    shutil.copytree(packed.folder / "results/quick/archive", project.folder / "models")
    (example,) = (project.folder / "examples").glob(f"{head}*")
    settings = [f"patient={example}/cases.tsv", "models=models", "predict={other_segments: predict}"]
    done = project.snakemake("predict", "--configfile", f"{example}/config.yaml", "--config", *settings)
    assert done.returncode == 0, done.stdout[-4000:]
    (path,) = (project.folder / "results").glob(f"{example.name}/patients/{head}/*/pinnochio_plus/certificate.json")
    said = json.loads(path.read_text())
    assert said["measures"]["inverted"] == 0 and said["measures"]["min_jacobian"] > 0
    assert not said["in_distribution"]["within"] and not said["in_distribution"]["anatomy"]["within"]
    assert (path.parent / "index.html").is_file()
