"""A study that was killed can go on, and one that is running is left alone."""

import subprocess
import sys
import time

import pytest

from workflow.unlock import processes, unlock

WAIT = "import time; time.sleep(100)"


@pytest.fixture
def folder(tmp_path):
    """A study's folder with a lock."""
    for name in (".snakemake/locks", ".snakemake/scripts"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / ".snakemake/locks/0.input.lock").write_text("results/tables/accuracy.csv\n")
    (tmp_path / ".snakemake/scripts/tmpabc.pretrain.py").write_text(WAIT)
    (tmp_path / "snakemake").write_text(WAIT)
    return tmp_path


def started(folder, *words):
    process = subprocess.Popen([sys.executable, *words], cwd=folder)
    while process.pid not in [other.pid for other in processes(folder)]:
        time.sleep(0.01)
    return process


def test_jobs_without_their_study_are_ended_and_the_lock_is_gone(folder):
    job = started(folder, str(folder / ".snakemake/scripts/tmpabc.pretrain.py"))
    part = started(folder, "snakemake", "--mode", "subprocess")
    other = started(folder, "-c", WAIT)
    try:
        assert set(unlock(folder)) == {job.pid, part.pid}
        assert job.poll() is not None and part.poll() is not None and other.poll() is None
        assert not (folder / ".snakemake/locks").exists()
    finally:
        for process in (job, part, other):
            process.kill()


def test_a_study_that_runs_is_left_alone(folder):
    study = started(folder, "snakemake", "--cores", "2")
    job = started(folder, str(folder / ".snakemake/scripts/tmpabc.pretrain.py"))
    try:
        with pytest.raises(SystemExit, match=f"a study is running there .process {study.pid}"):
            unlock(folder)
        assert job.poll() is None and (folder / ".snakemake/locks/0.input.lock").exists()
    finally:
        study.kill()
        job.kill()
