"""Every command of the README and the pages is understood: planned by Snakemake or make, or its options known."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from pinnochio.patients.archive import RANGES, READ_BY_NETWORKS, Archive, calibration_file, network_file
from tests.config.test_readme import PAGES
from tests.study.conftest import ROOT, Project

FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.M | re.S)
# What the pages leave to the reader to fill in.
FILLED_IN = {
    "patient=FOLDER": "patient=P01",
    "path/to/archive": "results/archive",
    "path/to/folder": "elsewhere",
    "NAME": "ours",
    "{nodes}": "500",
    "[--device cuda]": "--device cuda",
}


def commands(page: Path) -> set[tuple[str, ...]]:
    """The commands of a page, filled in: lines of its bash blocks, and code that begins with a program or an option."""
    text, lines = page.read_text(encoding="utf-8"), []
    for language, block in FENCE.findall(text):
        if language == "bash":
            lines += block.replace("\\\n", " ").splitlines()
    for span in (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", FENCE.sub("", text))):
        if re.match(r"(snakemake|make|python) ", span):
            lines.append(span)
        elif re.match(r"--(config|configfile|resources|default-resources) ", span):
            lines.append(f"snakemake {span}")
        elif re.match(r"\w+\.py -", span):
            lines.append(f"python tests/benchmarks/{span}")
    for place, filled_in in FILLED_IN.items():
        lines = [command.replace(place, filled_in) for command in lines]
    lines = [re.sub(r" --cores \d+", "", command) for command in lines]
    return {tuple(shlex.split(command, comments=True)) for command in lines} - {()}


def named_blocks(page: Path) -> dict[str, str]:
    """The blocks of a page whose first line is a comment that names their file, by that name."""
    blocks = (block.partition("\n") for _, block in FENCE.findall(page.read_text(encoding="utf-8")))
    return {first[2:]: rest for first, _, rest in blocks if re.fullmatch(r"# [\w./]+\.\w+", first)}


WRITTEN = sorted(set().union(*map(commands, PAGES)))


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    """A project with all that the commands name; empty files will do, because no job runs."""
    project = Project(tmp_path_factory.mktemp("documented"))
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    method, folds = config["predict"]["method"], ["1", "2"]
    archive = project.folder / "results/archive"
    names = [RANGES, calibration_file(method), *(network_file(method, fold) for fold in folds)]
    files = [archive / name for name in names]
    files += [project.folder / f"P01/{name}" for name in ("segmentation.nii.gz", "plan.json")]
    rows = ["case\tsegmentation\tplan\tpostop"]
    for number in range(10):
        parts = [f"C{number}.{suffix}" for suffix in ("nii.gz", "json", "ply")]
        rows.append("\t".join([f"C{number}", *parts]))
        files += [project.folder / part for part in parts]
    files += [project.folder / f"elsewhere/V{number:02d}.npz" for number in range(1, 41)]
    labels = [project.folder / "results/headsq/labels.nii.gz"]
    labels.append(project.folder.parent / "shared/data/artisynth_face/labels_1mm.nii.gz")
    for file in [*files, *labels]:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    (project.folder / "cases.tsv").write_text("\n".join(rows) + "\n")
    for path, text in named_blocks(ROOT / "docs/new_method.md").items():
        if path.endswith(".yaml"):
            (project.folder / path).write_text(text)
    settings = {key: config[key] for key in READ_BY_NETWORKS}
    methods = {method: {"corrections": 1, "lift": "elastic", "usual": {}}}
    Archive("virtual cohort", 40, config["segments"], folds, methods, settings, "abc", "def").write(archive)
    return project


def run(*words: str) -> str:
    """What a program says that is run in the project's own folder; it must succeed."""
    done = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    return done.stdout


@pytest.mark.parametrize("command", WRITTEN, ids=" ".join)
def test_a_documented_command_is_understood(project, command):
    program, *words = command
    if program == "snakemake":
        if "--report" in words:  # needs the results
            words = words[: words.index("--report")] + words[words.index("--report") + 2 :]
        done = project.snakemake("--dry-run", "--quiet=all", *words)
        assert done.returncode == 0, done.stdout[-3000:]
    elif program == "make":
        run("make", "--dry-run", *words)
    elif program == "python":
        script, *arguments = words
        said = run(sys.executable, script, "--help")
        for word in arguments:
            assert not word.startswith("--") or word in said, word
    else:
        assert command == ("source", ".venv/bin/activate") and "-m venv --clear .venv" in run("make", "-nB", "env")
