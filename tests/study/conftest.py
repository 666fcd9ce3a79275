"""The real workflow, run in a temporary copy of the project."""

import shutil

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
    """A project with the example of the CT headsq."""
    return project
