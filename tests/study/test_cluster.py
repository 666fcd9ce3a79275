"""Studies through a real SLURM of one node on loopback: what jobs ask for, one that is killed, a registry of 200."""

import json
import os
import re
import shutil
import subprocess
import time
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

from tests.helpers.study import Project, jobs, moving, write_case

SLURM = Path(__file__).resolve().parents[1] / "cluster"
NEEDED = ("munged", "slurmctld", "slurmd", "sbatch")
MISSING = [name for name in NEEDED if not shutil.which(name)] + ([] if os.geteuid() == 0 else ["root"])
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(bool(MISSING), reason=f"a SLURM on loopback lacks {MISSING}: apt-get install munge slurm-wlm"),
]
STUDY = ["--configfile", "config/quick.yaml", "own.yaml"]
CHANGES = "methods: [no_change, pinnochio]\nreference: pinnochio\nablation: []\n"
CHANGES += "virtual: {patients: 4}\npretraining: {steps: 250}\n"
CLUSTER = ["--workflow-profile", "profiles/slurm", "--cores", "2", "--slurm-status-command", "squeue"]
CLUSTER += ["--slurm-init-seconds-before-status-checks", "2", "--seconds-between-status-checks", "2"]
REGISTRY = "cohort: cases.tsv\nmethods: [no_change, fem_bonded]\nreference: fem_bonded\nablation: []\n"
PATIENTS, SCANNED, ADDED = 200, 8, 20
NAMES = [f"P{number:03d}" for number in range(1, PATIENTS + ADDED + 1)]
BROKEN, LARGE, LARGEST = "P050", "P100", "P150"
WANTED = [f"results/quick/cases/{name}/judged.h5" for name in NAMES[:SCANNED]]
# What needs more memory than it may have is killed, as by the kernel.
KILLED = """    attach_log(snakemake.log[0])
    import json, os, signal
    if json.load(open("needs.json")).get(snakemake.wildcards.case, 0) > snakemake.resources.mem_mb:
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slurm")
    subprocess.run([SLURM / "start_slurm.sh", folder], check=True)
    yield folder
    subprocess.run([SLURM / "stop_slurm.sh", folder], check=True)


def sent(folder: Path) -> list[dict[str, str]]:
    """What SLURM says of every job of the project in the folder."""
    said = subprocess.run(["scontrol", "--oneliner", "show", "jobs"], stdout=subprocess.PIPE, text=True, check=True)
    listed = [dict(re.findall(r"([\w/]+)=(\S*)", line)) for line in said.stdout.splitlines()]
    return [job for job in listed if job["WorkDir"] == str(folder)]


def last_job(folder: Path, rule: str) -> dict[str, str]:
    """What SLURM says of the job of the rule that was submitted last."""
    return max((job for job in sent(folder) if rule in job["Comment"]), key=lambda job: int(job["JobId"]))


def test_the_quick_study_through_sbatch_with_a_job_killed(slurm, project, tmp_path_factory):
    results, alone = project.folder / "results/quick", Project(tmp_path_factory.mktemp("alone"))
    for copy in (project, alone):
        (copy.folder / "own.yaml").write_text(CHANGES)
    run, checkpoint = project.start(*CLUSTER, *STUDY), results / "folds/1/pinnochio/pretrained.resume.pt"
    while run.poll() is None and not checkpoint.exists():
        time.sleep(0.5)
    listed = [job for job in sent(project.folder) if job["JobState"] == "RUNNING" and "pretrain" in job["Comment"]]
    for job in listed:
        subprocess.run(["scancel", "--full", "--signal=KILL", job["JobId"]], check=True)
    assert run.wait() == 0, project.said[-3000:]
    said = "".join(path.read_text() for path in (project.folder / ".snakemake/log").glob("*.log"))
    assert listed and "Error in rule pretrain" in project.said and "Trying to restart" in said
    logs = "".join(path.read_text() for path in (results / "logs/pretrain").glob("*.log"))
    assert "resumed at step" in logs

    mesh, training = last_job(project.folder, "model_case"), last_job(project.folder, "pretrain")
    assert "follow_up" in mesh["Comment"] and mesh["MinMemoryNode"] == "4060M"
    assert training["TimeLimit"] != mesh["TimeLimit"] and "TresPerJob" not in training

    assert alone.snakemake(*STUDY).returncode == 0
    for table in ("cases", "accuracy"):
        rows, expected = (study.repeatable(f"quick/tables/{table}.csv") for study in (project, alone))
        pd.testing.assert_frame_equal(rows, expected)

    # A GPU is asked for where one is offered. This one has no driver, so the training falls back on the processor.
    again = "results/quick/folds/1/pinnochio/pretrained.pt"
    done = project.snakemake(*CLUSTER, "--resources", "gpu=1", "--forcerun", again, *STUDY, "--", again)
    assert done.returncode == 0, done.stdout[-3000:]
    assert last_job(project.folder, "pretrain")["TresPerJob"] == "gres:gpu:1"


def write_table(folder: Path, patients: int) -> None:
    """The first ones are a head with a scan, the others boxes; one of these cannot be read."""
    files = dict.fromkeys(NAMES[:SCANNED], "head/segmentation.nii.gz\thead/plan.json\thead/postop.ply")
    files |= dict.fromkeys(NAMES[SCANNED:patients], "box.nii.gz\tbox.json\t") | {BROKEN: "broken.nii.gz\tbox.json\t"}
    rows = [f"{name}\t{row}\n" for name, row in files.items()]
    (folder / "cases.tsv").write_text("".join(["case\tsegmentation\tplan\tpostop\n", *rows]))


@pytest.fixture(scope="module")
def registry(slurm, tmp_path_factory):
    """A project of 200 patients, and how its study ended, what it said and what it had sent: with one that cannot be
    read and two that need more memory than is asked for, and run again after these are mended."""
    project = Project(tmp_path_factory.mktemp("registry"))
    folder, head = project.folder, "results/quick/virtual/V01"
    project.quick("--", f"{head}/postop.ply")
    (folder / head).rename(folder / "head")
    plan = json.loads((folder / "head/plan.json").read_text())
    (folder / "head/plan.json").write_text(json.dumps({"segments": plan["segments"]}))
    write_case(folder, "box", plan={"segments": moving("lefort1")})
    (folder / "broken.nii.gz").write_text("no image\n")
    write_table(folder, PATIENTS)
    (folder / "own.yaml").write_text(REGISTRY)
    script = folder / "scripts/patient/import_case.py"
    script.write_text(script.read_text().replace("    attach_log(snakemake.log[0])\n", KILLED))
    runs = []
    for needs in ({LARGE: 5000, LARGEST: 10_000}, {}):
        (folder / "needs.json").write_text(json.dumps(needs))
        code = project.start(*CLUSTER, *STUDY, "--", *WANTED).wait()
        runs.append((code, project.said, sent(folder)))
        shutil.copy(folder / "box.nii.gz", folder / "broken.nii.gz")
    return project, *runs


def test_who_cannot_be_read_or_is_killed_for_memory_twice_is_named_and_the_others_go_on(registry):
    project, (code, said, listed), _ = registry
    reasons = re.findall(r"^Failed \(\d of 2\): import_case: (.*)", said, re.M)
    assert code == 1 and len(reasons) == 2, said[-3000:]
    assert any(f"'{BROKEN}'" in words and "broken.nii.gz" in words for words in reasons)
    assert any("killed for its memory" in words and f"{LARGEST}.log" in words for words in reasons)
    # All that fail are sent once more, which is enough for one of them.
    memory = Counter(job["MinMemoryNode"] for job in listed if "import_case" in job["Comment"])
    assert memory == {"4030M": PATIENTS - 1, "4000M": 1, "8060M": 2, "8000M": 1}
    logs = (project.folder / "results/quick/logs/import_case").iterdir()
    assert {path.stem for path in logs} == {*NAMES[:PATIENTS]}


def test_the_study_goes_on_in_two_jobs_a_patient_and_who_is_added_is_imported_alone(registry):
    project, _, (code, said, listed) = registry
    assert code == 0 and all((project.folder / file).is_file() for file in WANTED), said[-3000:]
    made = Counter(job["Comment"] for job in listed)
    assert made["rule_before_import_case_register_postop"] == made["rule_after_choose_samples_model_case"] == SCANNED
    assert made["rule_before_import_case"] == PATIENTS - SCANNED + 5  # three are sent once more, two of them again
    assert len(listed) == PATIENTS + 5 + SCANNED + 3  # two folds' folders, and the check

    write_table(project.folder, PATIENTS + ADDED)
    planned = project.snakemake("--dry-run", *STUDY, "--", *WANTED).stdout
    assert jobs(planned) == {"import_case": ADDED, "gather": 2, "check_cohort": 1}
