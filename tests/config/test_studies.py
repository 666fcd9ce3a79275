"""A study goes with its folder and its include line, and the rest stands."""

import re
import shutil
from pathlib import Path

import pytest

from pinnochio.code import ROOT
from tests.helpers.sources import imported
from tests.helpers.study import Project

BUILDS_ON = {"planner": {"inverse"}}  # the page answers wishes; a study goes with what it builds on
STUDIES = sorted(path.parent.name for path in (ROOT / "workflow/studies").glob("*/rules.smk"))
SMALL = ["--config", "virtual={patients: 4}", "folds=2", "methods=[no_change, fem_sliding]", "reference=fem_sliding"]


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path)


@pytest.mark.parametrize("study", STUDIES)
def test_the_default_study_does_not_need_a_study_that_is_deleted(project, study):
    snakefile = project.folder / "Snakefile"
    for name in {study, *(other for other, needed in BUILDS_ON.items() if study in needed)}:
        shutil.rmtree(project.folder / "workflow/studies" / name)
        text = snakefile.read_text(encoding="utf-8")
        text, gone = re.subn(rf'include: "workflow/studies/{name}/rules.smk"\n', "", text)
        snakefile.write_text(text, encoding="utf-8")
        assert gone == 1
    done = project.dry_run(*SMALL, "--", "all", "report")
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.parametrize("study", STUDIES)
def test_no_study_imports_another(study):
    for path in (ROOT / "workflow/studies" / study).glob("*.py"):
        studies = {name.split(".")[1] for name in imported(path) if name.startswith("studies.")}
        assert studies <= {study} | BUILDS_ON.get(study, set()), path


def test_each_study_says_what_it_asks():
    for study in STUDIES:
        folder = Path(ROOT, "workflow/studies", study)
        assert (folder / "__init__.py").is_file() and (folder / "README.md").is_file(), study
