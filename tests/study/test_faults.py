"""A study that is killed in each of its stages goes on where it was, and ends with the tables of an unbroken one."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from workflow.unlock import unlock

pytestmark = pytest.mark.full
STUDY = ["--configfile", "config/quick.yaml", "own.yaml"]
CHANGES = "methods: [no_change, pinnochio_plus]\nreference: pinnochio_plus\nablation: []\nvirtual: {patients: 4}\n"
UNTRAINED = "methods: [no_change, fem_bonded]\nreference: fem_bonded\nvirtual: {patients: 2}\n"
# Scripts in the order in which the study comes to them.
STAGES = ["virtual_patient", "import_case", "operate_and_scan", "check_cohort", "model_patient", "follow_up"]
STAGES += ["pretrain", "finetune", "predict_cases"]
STAGES += ["tabulate"]


def running(project, script: str) -> bool:
    """Whether a job of the project is running the script."""
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = process.read_bytes().split(b"\0")
        except OSError:
            continue  # it has ended
        if any(word.startswith(bytes(project.folder)) and word.endswith(f".{script}.py".encode()) for word in words):
            return True
    return False


def killed_in(project, script: str) -> bool:
    """Run the study until a job runs the script, then kill all of it; False if the study ended before."""
    run = project.start("--cores", "2", *STUDY, start_new_session=True)
    while run.poll() is None:
        if running(project, script):
            time.sleep(1.0)  # into its work
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            return True
        time.sleep(0.02)
    return False


def test_a_study_killed_in_every_stage_ends_as_an_unbroken_one(project, tmp_path_factory):
    alone, missed = type(project)(tmp_path_factory.mktemp("alone")), []
    for copy in (project, alone):
        (copy.folder / "own.yaml").write_text(CHANGES)
    for script in STAGES:
        if not killed_in(project, script):
            missed.append(script)
        unlock(project.folder)
    assert not missed
    done = project.snakemake(*STUDY)
    assert done.returncode == 0, done.stdout[-3000:]
    left = [path for path in (project.folder / "results/quick").rglob(".*") if path.is_file()]
    assert not [path for path in left if re.match(r"\.\d+\.", path.name)], "half-written files are left"

    assert alone.snakemake(*STUDY).returncode == 0
    for table in ("cases", "accuracy"):
        rows, expected = (study.repeatable(f"quick/tables/{table}.csv") for study in (project, alone))
        pd.testing.assert_frame_equal(rows, expected)


def seeded(seed: int) -> list[str]:
    """The table of a study with this seed, in results of its own."""
    table = f"results/{seed}/tables/cases.csv"
    return ["--config", f"seed={seed}", f"pathvars={{results: results/{seed}}}", "--", table]


def test_two_studies_in_two_result_folders_do_not_disturb_each_other(project, tmp_path_factory):
    """Side by side from one copy of the project; each ends with the table of one that ran alone."""
    options, alone = [*STUDY, "--nolock"], type(project)(tmp_path_factory.mktemp("alone"))
    for copy in (project, alone):
        (copy.folder / "own.yaml").write_text(UNTRAINED)
    runs = [
        subprocess.Popen(
            [sys.executable, "-m", "snakemake", "--cores", "1", *options, *seeded(seed)],
            cwd=project.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        for seed in (1, 2)
    ]  # fmt: skip
    said = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0], said[0][-2000:] + said[1][-2000:]
    done = alone.snakemake(*options, *seeded(2))
    assert done.returncode == 0, done.stdout[-2000:]
    rows, expected = (study.repeatable("2/tables/cases.csv") for study in (project, alone))
    pd.testing.assert_frame_equal(rows, expected)
    assert not rows["cd"].equals(project.repeatable("1/tables/cases.csv")["cd"])
