"""Results on a disk of their own that is read-only or full: the study says so, and goes on when it is mended."""

import os
import re
import subprocess
import time

import pytest

from pinnochio.files import ROOM
from tests.helpers.study import VERBOSE, write_case

CONFIG = ("--config", "cohort=cases.tsv", "folds=2")
MODEL = "results/cases/P1/model.h5"


@pytest.fixture
def disk(project):
    """A disk of its own for the results of the project; the function that it yields changes its mount options."""

    def mount(*options: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            ["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", project.folder / "results"],
            capture_output=True,
            text=True,
            check=False,
        )

    (project.folder / "results").mkdir()
    done = mount("size=1g")
    if done.returncode:
        pytest.skip(f"a disk cannot be mounted here: {done.stderr.strip()}")
    yield lambda *options: mount("remount", *options).check_returncode()
    subprocess.run(["umount", project.folder / "results"], check=True)


@pytest.fixture
def case(project):
    """A cohort of one small patient without a scan."""
    row = write_case(project.folder).replace("P1.ply", "")
    (project.folder / "cases.tsv").write_text("case\tsegmentation\tplan\tpostop\n" + row)


def made(project):
    """When each result was written, logs and benchmarks aside."""
    results = project.folder / "results"
    files = [path.relative_to(results) for path in results.rglob("*") if path.is_file()]
    return {str(p): (results / p).stat().st_mtime_ns for p in files if p.parts[0] not in ("logs", "benchmarks")}


@pytest.mark.usefixtures("case")
def test_a_read_only_folder_is_refused_before_anything_is_made(project, disk):
    disk("ro")
    done = project.snakemake(*CONFIG, "--", MODEL)
    assert done.returncode != 0 and "Error in rule" not in done.stdout
    assert "results: read-only file system. Remedy: make its folder" in done.stdout
    assert not made(project)


@pytest.mark.full
@pytest.mark.usefixtures("case")
def test_a_disk_that_fills_up_stops_the_study_which_goes_on_where_there_is_room(project, disk):
    """A run that does not fit is not begun. Where the disk fills up meanwhile there is room for what is read in."""
    small = f"size={ROOM + 400 * 1024}"
    disk(small)
    done = project.snakemake(*CONFIG, "--", MODEL)
    assert done.returncode != 0 and "there, and 0 MB are free. Nothing was started" in done.stdout and not made(project)
    disk("size=1g")
    running = project.start("--cores", "2", *CONFIG, "--", MODEL, env=os.environ | VERBOSE)
    while not (project.folder / "results/cohort.csv").exists():
        assert running.poll() is None, project.said[-3000:]
        time.sleep(0.05)
    disk(small)
    assert running.wait(timeout=600) != 0
    said = "StorageError: results/cases/P1/mesh.vtu: no space left on device. Remedy: make room on its disk"
    assert said in project.said and project.said.count("Error in rule") == 1, project.said[-3000:]
    assert said in (project.folder / "results/logs/model_case/P1.log").read_text()
    before = made(project)
    assert {path.split("/")[-1] for path in before} >= {"skin.vtp", "import.json", "cohort.csv"}
    assert not any(re.search(r"/(\.\d|mesh)[^/]*$", path) for path in before), before

    disk("size=1g")
    done = project.snakemake(*CONFIG, "--", MODEL)
    assert done.returncode == 0, done.stdout[-3000:]
    after = made(project)
    assert "cases/P1/model.h5" in after and before.items() <= after.items()
