"""The real workflow, run in a temporary copy of the project."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared/data"  # real heads, which are not part of the project
SOON = ("--max-jobs-per-timespan", "2000/2s")  # Snakemake ends one time span after its last job
PARTS = ("Snakefile", "rules", "scripts", "workflow", "config", "profiles", "envs", "examples")


class Project:
    """A copy of the project in which Snakemake can be run; compiled loops come along where there are any."""

    def __init__(self, folder: Path):
        self.folder = folder
        for part in PARTS:
            source = ROOT / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("*.pyc"))
            elif source.exists():
                shutil.copy(source, folder / part)

    def snakemake(self, *arguments: str, cores: int = 2) -> subprocess.CompletedProcess:
        """Run Snakemake with the arguments; its output is in `stdout` (both streams)."""
        return subprocess.run(
            [sys.executable, "-m", "snakemake", "--cores", str(cores), *SOON, *arguments],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )

    def start(self, *arguments: str, **options) -> subprocess.Popen:
        """Begin to run Snakemake; its output, both streams, goes to `said.txt` of the folder."""
        with open(self.folder / "said.txt", "w", encoding="utf-8") as said:
            return subprocess.Popen(
                [sys.executable, "-m", "snakemake", *SOON, *arguments],
                cwd=self.folder,
                stdout=said,
                stderr=subprocess.STDOUT,
                **options,
            )

    @property
    def said(self) -> str:
        return (self.folder / "said.txt").read_text(encoding="utf-8")

    def repeatable(self, table: str) -> pd.DataFrame:
        """A table, named by its path below `results`, without timings."""
        return without_timings(pd.read_csv(self.folder / "results" / table))

    def quick(self, *arguments: str) -> str:
        """Run the quick study; returns the output, fails if Snakemake does."""
        done = self.snakemake("--configfile", "config/quick.yaml", *arguments)
        assert done.returncode == 0, done.stdout[-4000:]
        return done.stdout


def without_timings(table: pd.DataFrame) -> pd.DataFrame:
    """A table without the columns that differ from run to run."""
    return table[[column for column in table if not re.search(r"seconds|threads", column)]]


def jobs(said: str) -> dict[str, int]:
    """Number of jobs of each rule, from what Snakemake says at the start of a run."""
    table = said.split("Job stats:")[1].split("\n\n")[0]
    return {name: int(count) for name, count in re.findall(r"^(\w+) +(\d+)$", table, re.M) if name != "total"}


def made_tables(said: str) -> set[str]:
    """Names of the tables that Snakemake says it makes."""
    return set(re.findall(r"Make the table (\w+)", said))


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
