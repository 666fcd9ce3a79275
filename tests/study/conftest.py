"""The real workflow, run in a temporary copy of the project."""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.settings import DATA
from tests.helpers.study import Project


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark the tests that share the finished quick study, so that all others can run beside them."""
    for item in items:
        if "studied" in getattr(item, "fixturenames", ()):
            item.add_marker("studied")


@pytest.fixture
def project(tmp_path) -> Project:
    return Project(tmp_path)


@pytest.fixture(scope="session")
def studied(tmp_path_factory) -> Project:
    """A project whose quick study has been run once."""
    project = Project(tmp_path_factory.mktemp("study"))
    project.quick()
    return project


@pytest.fixture(scope="session")
def packed(studied, tmp_path_factory) -> Project:
    """A copy of the finished quick study with its archive."""
    project = Project(tmp_path_factory.mktemp("packed"))
    for part in ("results", ".snakemake"):
        shutil.copytree(studied.folder / part, project.folder / part, dirs_exist_ok=True)
    project.quick("--", "archive")
    return project


@pytest.fixture
def artisynth(project) -> Project:
    """A project in which the example of the ArtiSynth face finds its label map."""
    labels, example = DATA / "artisynth_face/labels_1mm.nii.gz", project.folder / "examples/artisynth_face"
    if not labels.is_file():
        pytest.skip(f"the ArtiSynth label map is not at {labels}")
    (example / "cases.tsv").write_text(
        f"case\tsegmentation\tplan\tpostop\nartisynth\t{labels}\t{example}/setback_5mm.json\t\n"
    )
    return project


@pytest.fixture
def headsq(project) -> Project:
    """A project in which the example of the CT headsq has its label map, made by the command that its comment gives."""
    ct = DATA / "headsq/headsq_quarter.nrrd"
    if not ct.is_file():
        pytest.skip(f"the CT is not at {ct}")
    config = (project.folder / "examples/headsq/config.yaml").read_text(encoding="utf-8")
    comment = [line[1:] for line in config.splitlines() if line.startswith("#")]
    start = next(number for number, line in enumerate(comment) if "segment_ct.py" in line)
    python, script, named, labels, *options = shlex.split(comment[start].rstrip("\\") + comment[start + 1])
    assert (python, Path(named).name, labels) == ("python", ct.name, "results/headsq/labels.nii.gz")
    made = subprocess.run(
        [sys.executable, script, str(ct), labels, *options],
        cwd=project.folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    return project
