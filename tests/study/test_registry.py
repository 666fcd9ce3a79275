"""A registry's day: patients are added to a finished study, and one withdraws (nothing is run)."""

import re
from base64 import urlsafe_b64encode
from pathlib import Path

import pytest

from tests.helpers.study import Project, jobs, write_cohort
from workflow.withdraw import withdraw

OF_A_PATIENT = ("import_case", "register_postop", "model_case", "choose_samples")
STUDY = ("--config", "cohort=cases.tsv", "methods=[no_change, pinnochio]", "ablation=[]", "folds=3")
NAMES = [f"P{number}" for number in range(1, 13)]


def finished(project: Project, names: list[str]) -> Project:
    """A study of these patients that counts as finished: empty files will do."""
    write_cohort(project, names, [])
    said = project.forked("--summary", "--cores", "1", *STUDY).stdout
    for name in re.findall(r"^(results/\S+)\t", said, re.M):
        file = project.folder / name / (".snakemake_timestamp" if "/held_out/" in name else "")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text('{"config": {}}')
    done = project.snakemake("--touch", "--forceall", *STUDY)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Nothing to be done" in planned(project)
    return project


def planned(project: Project) -> str:
    done = project.dry_run(*STUDY)
    assert done.returncode == 0, done.stdout[-2000:]
    return done.stdout


@pytest.mark.parametrize(("patients", "added"), [(12, 2), pytest.param(200, 20, marks=pytest.mark.full)])
def test_patients_that_are_added_are_made_alone_with_what_is_of_all(project, patients, added):
    names = [f"P{number}" for number in range(1, patients + added + 1)]
    finished(project, names[:patients])
    write_cohort(project, names, [])
    said = planned(project)
    counted = jobs(said)
    assert {rule: counted[rule] for rule in OF_A_PATIENT} == dict.fromkeys(OF_A_PATIENT, added)
    assert counted["check_cohort"] == 1 and counted["finetune"] == 3
    others = {"check_cohort", "gather", "pretrain", "finetune", "predict_cases", "tabulate"}
    assert set(counted) <= {*OF_A_PATIENT, *others} | {"provenance", "all"}


def test_a_patient_that_withdraws_leaves_nothing_and_the_others_are_not_made_again(project, monkeypatch):
    folder = finished(project, NAMES).folder
    (folder / "results/logs/predict").mkdir(parents=True, exist_ok=True)
    (folder / "results/logs/predict/1_no_change.log").write_text("P1: 0.1 s\n")
    (folder / "results/logs/predict/2_no_change.log").write_text("P11: 0.1 s\n")
    (folder / "results/benchmarks/model_case").mkdir(parents=True, exist_ok=True)
    for name in ("P1", "P11"):
        (folder / f"results/benchmarks/model_case/{name}.tsv").touch()
    record = folder / ".snakemake/metadata" / urlsafe_b64encode(b"results/cases/P1/model.h5").decode()
    assert record.is_file()
    monkeypatch.chdir(folder)
    table = folder / "cases.tsv"  # as a German Excel leaves it
    table.write_text("\ufeffsep=;\n" + table.read_text().replace("\t", ";"), encoding="utf-8")
    assert withdraw("P1", Path("results"), Path("cases.tsv")) > 20 and not record.exists()
    left = [path.relative_to(folder).as_posix() for path in (folder / "results").rglob("*")]
    assert not [path for path in left if "P1" in path.replace(".", "/").split("/")]
    assert "results/cases/P11/model.h5" in left and "results/benchmarks/model_case/P11.tsv" in left
    assert not [path for path in left if path.endswith((".pt", "metrics.csv", "cohort.csv")) or "tables/" in path]
    assert "results/logs/predict/2_no_change.log" in left and "results/logs/predict/1_no_change.log" not in left
    assert [row.split(";")[0] for row in table.read_text().splitlines()] == ["sep=", "case", *NAMES[1:]]
    counted = jobs(planned(project))
    assert not counted.keys() & {*OF_A_PATIENT} and counted["finetune"] == 3 and counted["gather"] > 0
