"""The report of the quick study, and Snakemake's own."""

import re

from tests.helpers.study import jobs


def made(studied, *arguments) -> str:
    """What Snakemake says that makes the report."""
    done = studied.snakemake("report", *arguments, "--configfile", "config/quick.yaml")
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


def test_the_report_shows_what_has_been_measured(studied):
    tables = studied.folder / "results/quick/tables"
    made(studied)
    page = (studied.folder / "results/quick/report.html").read_text(encoding="utf-8")
    sections = re.findall(r'<section id="(\w+)">', page)
    parts = ["accuracy", "better", "ablation", "regions", "landmarks", "training", "stages", "quality"]
    assert sections == [*parts, "patients", "provenance"]
    for name in parts:
        assert re.search(r"<tbody>.*</tbody>", (tables / f"{name}.html").read_text(), re.DOTALL)[0] in page
    assert re.findall(r'id="patient-(\w+)"', page) == ["V01", "V02"]

    assert "Nothing to be done" in made(studied, "--dry-run")
    measured = tables / "stability.html"  # of a further target; it is shown as soon as it is there
    measured.touch()
    assert jobs(made(studied, "--dry-run")).keys() == {"write_report", "report"}
    measured.unlink()


def test_snakemakes_own_report_has_the_captions(studied):
    made(studied)
    made(studied, "--report", "own.html")
    page = (studied.folder / "own.html").read_text(encoding="utf-8")
    for said in (
        "each patient predicted by models that",
        "in the form of the paper",
        "The tissue from behind",
        "figures/V02.png",
    ):
        assert said in page
