"""Every command of the README and the pages is understood: planned by Snakemake or make, or its options known."""

import functools
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from string import Template

import pytest
import yaml

from pinnochio.patients.model_archive import RANGES, READ_BY_NETWORKS, Archive, calibration_file, network_file
from tests.helpers.documents import PAGES, commands, named_blocks
from tests.helpers.rules import RULE_FILES
from tests.helpers.settings import ROOT
from tests.helpers.study import Project, jobs

PATIENTS, FOLDS = 4, 2  # the plan of a study grows with them, and so does the time that it takes
RULE = r"^(?:use rule \w+ as|rule) (\w+)"
# What else stands in a command without a target changes no job: there the first targets tell that it is understood.
DECIDES = re.compile(r"--configfile$|(cohort|external|models|pathvars|patient|predict|tradeoff|uncertainty)=")
WRITTEN = sorted(set().union(*map(commands, PAGES)))


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    """A project with all that the commands name; empty files will do, because no job runs."""
    project = Project(tmp_path_factory.mktemp("documented"))
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    config["virtual"]["patients"], config["folds"] = PATIENTS, FOLDS
    (project.folder / "config/config.yaml").write_text(yaml.safe_dump(config))
    learning = project.folder / "workflow/studies/learning/learning.yaml"
    fewer = yaml.safe_load(learning.read_text(encoding="utf-8")) | {"virtual": {"patients": PATIENTS}}
    learning.write_text(yaml.safe_dump(fewer))
    method, folds = config["predict"]["method"], [str(1 + fold) for fold in range(FOLDS)]
    archive = project.folder / "results/archive"
    names = [RANGES, calibration_file(method), *(network_file(method, fold) for fold in folds)]
    files = [archive / name for name in names]
    names = ("segmentation.nii.gz", "plan.json", "wish.csv")
    files += [project.folder / f"{home}/{name}" for home in ("P01", "results/virtual/V01") for name in names]
    files += [project.folder / name for name in ("P01/plans/further.json", "models/front.json")]
    rows = ["case\tsegmentation\tplan\tpostop\tpostop_bones"]
    for number in range(PATIENTS):
        parts = [f"C{number}.{suffix}" for suffix in ("nii.gz", "json", "ply")]
        rows.append("\t".join([f"C{number}", *parts, parts[-1]]))
        files += [project.folder / part for part in parts]
    files += [project.folder / f"elsewhere/V{number:02d}.npz" for number in range(1, PATIENTS + 1)]
    frozen = ("SHA256SUMS.development", "SHA256SUMS.locked", "scaling_patients.csv")
    files += [project.folder / "results/reference" / name for name in frozen]
    labels = [project.folder.parent / "shared/data/artisynth_face/labels_1mm.nii.gz"]
    for file in [*files, *labels]:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    (project.folder / "cases.tsv").write_text("\n".join(rows) + "\n")
    (project.folder / "mine.yaml").write_text("{}\n")
    for path, text in named_blocks(ROOT / "docs/how-to/new_method.md").items():
        if path.endswith(".yaml") and "/" not in path:  # a user's own; the others are the project's
            (project.folder / path).write_text(text)
    settings = {key: config[key] for key in READ_BY_NETWORKS}
    methods = {method: {"corrections": 1, "lift": "elastic", "usual": {}}}
    Archive("virtual cohort", 40, config["segments"], folds, methods, settings, "abc", "def").write(archive)
    return project


@functools.cache
def run(*words: str) -> str:
    """What a program says that is run in the project's own folder; it must succeed."""
    done = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    return done.stdout


def test_after_the_quick_study_its_report_is_shown_but_patients_are_predicted_as_ever(tmp_path):
    """The models that come along were trained on the mesh of the default study, not on the quick one's."""
    for name in ("results/quick/provenance.json", "envs/requirements.lock"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    planned = ("make", "-n", "-C", str(tmp_path), "-f", str(ROOT / "Makefile"), "PATIENT=P01", "CONFIG=")
    assert "--configfile config/quick.yaml" in run(*planned, "report")
    assert "--configfile" not in run(*planned, "predict")
    assert "--configfile own.yaml" in run(*planned[:-1], "CONFIG=own.yaml", "predict")


def test_make_keeps_a_cache_where_home_cannot_be_written(tmp_path):
    made = ("make", "-pn", "-f", str(ROOT / "Makefile"), "PATIENT=P01", "predict")
    said = {home: run("env", "-u", "XDG_CACHE_HOME", f"HOME={home}", *made) for home in ("/dev/null", str(tmp_path))}
    assert [".snakemake/cache" in text for text in said.values()] == [True, False]


def test_make_hands_on_a_folder_as_it_is_named(tmp_path):
    """With blanks, and with what a shell would take for a command."""
    for name in ("envs/requirements.lock", ".venv/installed", ".venv/bin/python"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text('#!/bin/sh\nprintf "<%s>" "$@"\n')
    (tmp_path / ".venv/bin/python").chmod(0o755)
    patient = "PATIENT=My Patients/P01;echo 1"
    apart = ("env", "-u", "MAKEFLAGS", "-u", "MAKELEVEL")  # from the make that runs the tests
    said = run(*apart, "make", "-s", "-C", str(tmp_path), "-f", str(ROOT / "Makefile"), "predict", patient)
    assert said.endswith("<workflow/predict.py><patient=My Patients/P01;echo 1>")


def lines(command: tuple[str, ...]) -> list[tuple[tuple[str, ...], frozenset[str]]]:
    """Options and targets of each line of Snakemake that a command runs."""
    program, *words = command
    said = run("make", "--dry-run", *words) if program == "make" else ""
    said = Template(said).safe_substitute(dict(word.split("=", 1) for word in words if "=" in word))
    made = [shlex.split(line)[3:] for line in said.splitlines() if line.startswith(".venv/bin/snakemake --cores")]
    split = []
    for line in [words] if program == "snakemake" else made:
        if "--report" in line:  # needs the results
            line[line.index("--report") :] = line[line.index("--report") + 2 :]
        after = line.index("--") if "--" in line else len(line)
        first = next((place for place, word in enumerate(line) if word.startswith("-")), after)
        split.append((tuple(line[first:after]), frozenset(line[:first] + line[after + 1 :]) or {"all"}))
    return split


@pytest.fixture(scope="module")
def planned(project):
    """Rules of the jobs that options plan, all targets that are written with them at once; they must be understood."""
    targets = defaultdict(set)
    for options, wanted in (line for command in WRITTEN for line in lines(command)):
        targets[options] |= wanted

    @functools.cache
    def plan(options: tuple[str, ...]) -> set[str]:
        wanted = targets[options]
        if options and not any(map(DECIDES.match, options)):
            wanted = wanted - {"all"} or {"check_cohort"}
        done = project.dry_run("--quiet=rules", *options, "--", *sorted(wanted))
        assert done.returncode == 0, done.stdout[-3000:]
        return set(jobs(done.stdout)) if "Job stats:" in done.stdout else set()

    return plan


@pytest.mark.parametrize("command", WRITTEN, ids=" ".join)
def test_a_documented_command_is_understood(planned, command):
    program, *words = command
    for options, _ in lines(command):
        planned(options)
    if program == "python":
        script, *arguments = words
        said = run(sys.executable, script, "--help")
        for word in arguments:
            assert not word.startswith("--") or word in said, word
    elif program not in ("snakemake", "make", "mkdir", "cp", "git", "rm"):
        assert command == ("source", ".venv/bin/activate") and "-m venv --clear .venv" in run("make", "-nB", "env")


def test_every_rule_is_planned_by_a_documented_command(planned):
    texts = [file.read_text(encoding="utf-8") for file in (ROOT / "Snakefile", *RULE_FILES)]
    rules = {name for text in texts for name in re.findall(RULE, text, re.M)}
    parts = {name for text in texts for name in re.findall(r"rules\.(\w+)\.input", text)}  # of another target
    used = (planned(options) for command in WRITTEN for options, _ in lines(command))
    unused = rules.difference(*used, parts)
    assert not unused, " ".join(sorted(unused))


def test_an_environment_that_is_elsewhere_is_not_emptied(tmp_path):
    elsewhere, project = tmp_path / "elsewhere/kept", tmp_path / "project"
    for folder in (elsewhere, project / "envs"):
        folder.mkdir(parents=True)
    (project / ".venv").symlink_to(elsewhere.parent)
    (project / "envs/requirements.lock").touch()
    made = ("make", "-f", str(ROOT / "Makefile"), f"PYTHON={sys.executable}", "env")
    done = subprocess.run(made, cwd=project, capture_output=True, text=True, check=False)
    assert done.returncode and "remove the link" in done.stdout and elsewhere.exists()
