"""The real workflow, run in a temporary copy of the project."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).resolve().parents[2]
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
            [sys.executable, "-m", "snakemake", "--cores", str(cores), *arguments],
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
                [sys.executable, "-m", "snakemake", *arguments],
                cwd=self.folder,
                stdout=said,
                stderr=subprocess.STDOUT,
                **options,
            )

    @property
    def said(self) -> str:
        return (self.folder / "said.txt").read_text(encoding="utf-8")

    def repeatable(self, table: str) -> pd.DataFrame:
        """A table, named by its path below `results`, without the columns that differ from run to run."""
        frame = pd.read_csv(self.folder / "results" / table)
        return frame[[column for column in frame if not re.search(r"seconds|threads", column)]]

    def quick(self, *arguments: str) -> str:
        """Run the quick study; returns the output, fails if Snakemake does."""
        done = self.snakemake("--configfile", "config/quick.yaml", *arguments)
        assert done.returncode == 0, done.stdout[-4000:]
        return done.stdout


def jobs(said: str) -> dict[str, int]:
    """Number of jobs of each rule, from what Snakemake says at the start of a run."""
    table = said.split("Job stats:")[1].split("\n\n")[0]
    return {name: int(count) for name, count in re.findall(r"^(\w+) +(\d+)$", table, re.M) if name != "total"}


@pytest.fixture
def project(tmp_path) -> Project:
    return Project(tmp_path)


@pytest.fixture(scope="session")
def studied(tmp_path_factory) -> Project:
    """A project whose quick study has been run once."""
    project = Project(tmp_path_factory.mktemp("study"))
    project.quick()
    return project
