import subprocess
import sys
from pathlib import Path

import pytest

BRANCH_OFF = Path(__file__).parents[2] / "workflow/branch_off.py"


@pytest.fixture
def trunk(tmp_path):
    """A process that has imported `statistics` and serves at `door`."""
    command = [sys.executable, BRANCH_OFF, "door", "statistics"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=tmp_path) as process:
        while not (tmp_path / "door").exists():
            assert process.poll() is None
        yield process
    assert process.returncode == 0 and not (tmp_path / "door").exists()


def start(folder, code):
    """The process that waits for a job."""
    job = f"import os, sys; print(os.getpid(), os.getppid(), 'statistics' in sys.modules, flush=True); {code}"
    (folder / "job.py").write_text(job)
    command = [sys.executable, "-IS", BRANCH_OFF, "door", sys.executable, "./job.py"]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize(("code", "status"), [("", 0), ("raise OSError", 1)])
def test_a_job_branches_off_and_its_status_comes_back(trunk, tmp_path, code, status):
    job = start(tmp_path, code)
    _, parent, imported = trunk.stdout.readline().split()
    assert (job.wait(), int(parent), imported) == (status, trunk.pid, b"True")


def test_who_kills_a_job_ends_its_branch(trunk, tmp_path):
    job = start(tmp_path, "import time; time.sleep(600)")
    assert trunk.stdout.readline()
    job.kill()
    trunk.communicate(timeout=60)  # reads until the branch, too, has ended


def test_without_a_trunk_a_job_runs_as_it_stands(tmp_path):
    job = start(tmp_path, "")
    assert job.communicate()[0].split()[0] == str(job.pid) and not job.returncode
