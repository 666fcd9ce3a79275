"""The real workflow in a temporary copy of the project, what a run says, and a small head as its input."""

import json
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import SimpleITK as sitk
import trimesh
from snakemake.cli import main

from pinnochio.virtual.procedures import Procedure
from tests.helpers.settings import ROOT

VERBOSE = {"VERBOSE": "1"}  # all that Snakemake says
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
            env=os.environ | VERBOSE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )

    def dry_run(self, *arguments: str, cores: int = 2) -> subprocess.CompletedProcess:
        """Plan what Snakemake would run."""
        return self.forked("--dry-run", "--cores", str(cores), *arguments)

    def forked(self, *arguments: str) -> subprocess.CompletedProcess:
        """Run Snakemake in a fork of this process: it has imported Snakemake and the library, which takes longer than
        a plan. Only for a copy of the project whose library nobody has edited."""
        said = self.folder / "said.txt"
        child = multiprocessing.get_context("fork").Process(target=_plan, args=(self.folder, said, arguments))
        child.start()
        child.join()
        return subprocess.CompletedProcess(arguments, child.exitcode, said.read_text(encoding="utf-8"))

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
        """A table, named by its path below `results`, without timings."""
        return without_timings(pd.read_csv(self.folder / "results" / table))

    def quick(self, *arguments: str) -> str:
        """Run the quick study; returns the output, fails if Snakemake does."""
        done = self.snakemake("--configfile", "config/quick.yaml", *arguments)
        assert done.returncode == 0, done.stdout[-4000:]
        return done.stdout

    def planned(self, *arguments: str) -> str:
        """What a dry run of the quick study says; fails if Snakemake does."""
        done = self.dry_run("--configfile", "config/quick.yaml", *arguments)
        assert done.returncode == 0, done.stdout[-4000:]
        return done.stdout


def _plan(folder: Path, said: Path, arguments: tuple[str, ...]) -> None:
    """Run Snakemake's command line in this process; both streams go to a file."""
    os.chdir(folder)
    os.environ |= VERBOSE
    with open(said, "w", encoding="utf-8", buffering=1) as stream:
        os.dup2(stream.fileno(), 1), os.dup2(stream.fileno(), 2)
        sys.stdout = sys.stderr = stream
        sys.argv = ["snakemake", *arguments]
        main()


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


def write_cohort(project, scanned, unscanned):
    """Empty files will do: no job runs."""
    rows = ["case\tsegmentation\tplan\tpostop"]
    for name in [*scanned, *unscanned]:
        for suffix in ("nii.gz", "json", "ply"):
            (project.folder / f"{name}.{suffix}").touch()
        scan = f"{name}.ply" if name in scanned else ""
        rows.append(f"{name}\t{name}.nii.gz\t{name}.json\t{scan}")
    (project.folder / "cases.tsv").write_text("\n".join(rows) + "\n")


def write_case(folder, name="P1", *, labels=None, plan=None, scale=1.0):
    """A small head: nested boxes with every structure, its plan and its post-operative skin."""
    if labels is None:
        labels = good_labels()
    image = sitk.GetImageFromArray(labels.transpose(2, 1, 0))
    image.SetSpacing((3.0, 3.0, 3.0))
    sitk.WriteImage(image, str(folder / f"{name}.nii.gz"))
    (folder / f"{name}.json").write_text(json.dumps(plan or {"case": name, "segments": moving("lefort1")}))
    sphere = trimesh.creation.box(extents=(100, 100, 100))
    sphere.apply_translation((60, 60, 60))
    sphere.apply_scale(scale)
    sphere.export(folder / f"{name}.ply")
    return f"{name}\t{name}.nii.gz\t{name}.json\t{name}.ply\n"


def moving(*names):
    """Segments of a plan: those of the small head, of which the named ones go 5 mm forward."""
    still = {"rotation": np.eye(3).tolist(), "translation": [0, 0, 0], "pivot": [0, 0, 0]}
    return dict.fromkeys(Procedure().segments, still) | dict.fromkeys(names, still | {"translation": [0, -5, 0]})


def good_labels():
    labels = np.zeros((40, 40, 40), np.uint8)
    labels[4:36, 4:36, 4:36] = 1
    labels[7:33, 7:33, 7:33] = 2
    for code, low in ((10, 28), (11, 22), (12, 10)):
        labels[10:30, 10:30, low : low + 5] = code
    labels[30:32, 10:30, 12:20], labels[8:10, 10:30, 12:20] = 13, 14
    return labels
