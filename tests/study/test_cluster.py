"""The quick study through a real SLURM of one node on loopback: what jobs ask for, and one that is killed."""

import os
import re
import shutil
import subprocess
import time
from pathlib import Path

import pandas as pd
import pytest

SLURM = Path(__file__).resolve().parents[1] / "cluster"
NEEDED = ("munged", "slurmctld", "slurmd", "sbatch")
MISSING = [name for name in NEEDED if not shutil.which(name)] + ([] if os.geteuid() == 0 else ["root"])
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(bool(MISSING), reason=f"a SLURM on loopback lacks {MISSING}: apt-get install munge slurm-wlm"),
]
STUDY = ["--configfile", "config/quick.yaml", "own.yaml"]
CHANGES = "methods: [no_change, pinnochio]\nablation: []\nvirtual: {patients: 4}\npretraining: {steps: 250}\n"


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slurm")
    subprocess.run([SLURM / "start_slurm.sh", folder], check=True)
    yield folder
    subprocess.run([SLURM / "stop_slurm.sh", folder], check=True)


def jobs() -> list[dict[str, str]]:
    """What SLURM says of every job."""
    said = subprocess.run(["scontrol", "--oneliner", "show", "jobs"], stdout=subprocess.PIPE, text=True, check=True)
    return [dict(re.findall(r"([\w/]+)=(\S*)", line)) for line in said.stdout.splitlines()]


def last_job(rule: str) -> dict[str, str]:
    """What SLURM says of the job of the rule that was submitted last."""
    return max((job for job in jobs() if rule in job["Comment"]), key=lambda job: int(job["JobId"]))


def test_the_quick_study_through_sbatch_with_a_job_killed(slurm, project, tmp_path_factory):
    results, alone = project.folder / "results/quick", type(project)(tmp_path_factory.mktemp("alone"))
    for copy in (project, alone):
        (copy.folder / "own.yaml").write_text(CHANGES)
    arguments = ["--workflow-profile", "profiles/slurm", "--cores", "2", "--slurm-status-command", "squeue"]
    arguments += ["--slurm-init-seconds-before-status-checks", "2", "--seconds-between-status-checks", "2"]
    run, checkpoint = project.start(*arguments, *STUDY), results / "folds/1/pinnochio/pretrained.resume.pt"
    while run.poll() is None and not checkpoint.exists():
        time.sleep(0.5)
    running = [job["JobId"] for job in jobs() if job["JobState"] == "RUNNING" and "pretrain" in job["Comment"]]
    for job in running:
        subprocess.run(["scancel", "--full", "--signal=KILL", job], check=True)
    assert run.wait() == 0, project.said[-3000:]
    assert running and "Error in rule pretrain" in project.said and "Trying to restart" in project.said
    logs = "".join(path.read_text() for path in (results / "logs/pretrain").glob("*.log"))
    assert "resumed at step" in logs

    mesh, training = last_job("model_case"), last_job("pretrain")
    # Four patients in one group, two of them at once.
    assert "follow_up" in mesh["Comment"] and mesh["MinMemoryNode"] == "8120M"
    assert training["TimeLimit"] != mesh["TimeLimit"] and "TresPerJob" not in training

    assert alone.snakemake(*STUDY).returncode == 0
    for table in ("cases", "accuracy"):
        rows, expected = (study.repeatable(f"quick/tables/{table}.csv") for study in (project, alone))
        pd.testing.assert_frame_equal(rows, expected)

    # A GPU is asked for where one is offered. This one has no driver, so the training falls back on the processor.
    again = "results/quick/folds/1/pinnochio/pretrained.pt"
    done = project.snakemake(*arguments, "--resources", "gpu=1", "--forcerun", again, *STUDY, "--", again)
    assert done.returncode == 0, done.stdout[-3000:]
    assert last_job("pretrain")["TresPerJob"] == "gres:gpu:1"
