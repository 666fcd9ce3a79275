"""The report of the quick study, and Snakemake's own."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from pinnochio.report.study_page import rounded
from tests.helpers.study import VERBOSE, jobs

FURTHER = ["--config", "report={further: [stability]}"]


@pytest.fixture(scope="module")
def reported(studied):
    """The quick study with its report."""
    studied.quick("--", "report")
    return studied


def test_the_report_shows_what_has_been_measured(reported):
    studied, tables = reported, reported.folder / "results/quick/tables"
    page = (studied.folder / "results/quick/report.html").read_text(encoding="utf-8")
    sections = re.findall(r'<section id="(\w+)">', page)
    parts = ["accuracy", "planned", "regions", "landmarks", "segments", "quality", "stages", "training"]
    assert sections == ["patients", "models", *parts, "way", "provenance"]
    assert "Demonstration." in page and "too few to tell methods apart" in page
    for name in parts:
        (body,) = re.findall(r"<tbody>(.*?)</tbody>", rounded((tables / f"{name}.html").read_text()), re.DOTALL)[:1]
        numbers = re.findall(r"<td>[-\d. ±]+</td>", body)
        assert numbers and all(number in page for number in numbers)
    assert re.findall(r'id="patient-(\w+)"', page) == ["V01", "V02"]

    assert "Nothing to be done" in studied.planned("--", "report")
    stray = tables / "stability.html"  # what is shown depends on the configuration, not on what lies there
    stray.touch()
    assert "Nothing to be done" in studied.planned("--", "report")
    stray.unlink()
    further = jobs(studied.planned("workflow/studies/stability/quick.yaml", *FURTHER, "--", "report"))
    once = ("tabulate", "render_table", "provenance", "write_report", "report")
    assert further == {"measure_stability": 10} | dict.fromkeys(once, 1)


def test_the_report_of_snakemake_has_the_captions(reported):
    reported.quick("--report", "own.html", "--", "report")
    page = (reported.folder / "own.html").read_text(encoding="utf-8")
    for said in (
        "each patient predicted by models that",
        "in the form of the paper",
        "The tissue from behind",
        "figures/V02.png",
    ):
        assert said in page


@pytest.mark.full
def test_the_report_is_made_where_the_workflow_is_a_module_of_another(reported, tmp_path):
    """In a folder of its own, where none of the project's files lie; the study's results come along."""
    shutil.copytree(reported.folder / "results/quick", tmp_path / "results/quick")
    configuration = [f"configfile: {str(reported.folder / f'config/{name}.yaml')!r}" for name in ("config", "quick")]
    module = f"module face:\n    snakefile: {str(reported.folder / 'Snakefile')!r}\n    config: config\n"
    (tmp_path / "Snakefile").write_text("\n".join([*configuration, module, "use rule * from face as face_*\n"]))

    def run(*options):
        command = [sys.executable, "-m", "snakemake", "--cores", "2", "--rerun-triggers", "mtime", *options]
        done = subprocess.run(
            [*command, "--", "face_report"],
            cwd=tmp_path,
            env=os.environ | VERBOSE,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-3000:]
        return done.stderr

    run("--touch")  # what other tests have touched is up to date
    (tmp_path / "results/quick/report.html").unlink()
    assert jobs(run()) == {"face_write_report": 1, "face_report": 1}
    ours, theirs = ((folder / "results/quick/report.html").read_text() for folder in (reported.folder, tmp_path))
    assert re.findall(r"<section id=.*", ours) == re.findall(r"<section id=.*", theirs) != []


def test_the_report_is_quiet_and_does_not_begin_a_study(project):
    """Without VERBOSE: how much would be made and how to go on; nothing of what Snakemake says else."""
    command = [sys.executable, "-m", "snakemake", "--cores", "2", "report", "--configfile", "config/quick.yaml"]
    quiet = {name: value for name, value in os.environ.items() if name != "VERBOSE"}
    done = subprocess.run(command, cwd=project.folder, env=quiet, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert done.returncode != 0 and not (project.folder / "results/quick/cases").exists()
    for words in ("jobs are left", "all report"):
        assert words in said
    assert "Reason:" not in said and "Job stats" not in said and len(said) < 2000
    assert jobs(project.planned("--", "all", "report"))["pretrain"] == 2
