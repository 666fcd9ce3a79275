"""A study goes with its folder and its include line, and the rest stands."""

import re
import shutil
from pathlib import Path

import pytest

from pinnochio.code import ROOT
from tests.helpers.sources import imported
from tests.helpers.study import Project

STUDIES = sorted(path.parent.name for path in (ROOT / "workflow/studies").glob("*/rules.smk"))
SMALL = ["--config", "virtual={patients: 4}", "folds=2", "methods=[no_change, fem_sliding]", "reference=fem_sliding"]


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path)


@pytest.mark.parametrize("study", STUDIES)
def test_the_default_study_does_not_need_a_study_that_is_deleted(project, study):
    shutil.rmtree(project.folder / "workflow/studies" / study)
    snakefile = project.folder / "Snakefile"
    text, gone = re.subn(rf'include: "workflow/studies/{study}/rules.smk"\n', "", snakefile.read_text(encoding="utf-8"))
    snakefile.write_text(text, encoding="utf-8")
    assert gone == 1
    done = project.dry_run(*SMALL, "--", "all", "report")
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.parametrize("study", STUDIES)
def test_no_study_imports_another(study):
    for path in (ROOT / "workflow/studies" / study).glob("*.py"):
        studies = {name.split(".")[1] for name in imported(path) if name.startswith("studies.")}
        assert studies <= {study}, path


def test_each_study_says_what_it_asks():
    for study in STUDIES:
        folder = Path(ROOT, "workflow/studies", study)
        assert (folder / "__init__.py").is_file() and (folder / "README.md").is_file(), study
