"""On a finished study, an edit of a module reruns the jobs whose scripts import it, and what follows; nothing else."""

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from pinnochio.code import LIBRARY, ROOT, closure, source_file, stages
from pinnochio.methods.registry import registry
from tests.helpers.rules import scripts_of_rules
from tests.helpers.settings import CONFIG
from tests.helpers.study import jobs

# What is imported by other modules, by name, and by a name of the job's own; methods/surface by nothing that is run.
ROOMS = ["geometry", "methods/pinnochio", "tables"]
FURTHER = (".", "mechanics", "methods/surface", "report", "virtual")
ROOMS += [pytest.param(room, marks=pytest.mark.full) for room in FURTHER]
METHODS = registry(CONFIG)
# What the scripts of these rules import by name, by the job's wildcard.
BY_NAME = {
    "pretrain": ("method", lambda method: METHODS[method].learner),
    "finetune": ("method", lambda method: METHODS[method].learner),
    "fit": ("method", lambda method: METHODS[method].learner),
    "predict_cases": ("method", lambda method: METHODS[method].predictor),
    "predict_both_motions": ("method", lambda method: METHODS[method].predictor),
    "tabulate": ("table", lambda table: f"pinnochio.tables.{'accuracy' if table == 'better' else table}"),
}


@dataclass
class Job:
    """A job of the study; wildcards: those that Snakemake does not leave out because what it reads has them too."""

    rule: str
    wildcards: dict[str, str]
    reads: list["Job"] = field(default_factory=list, repr=False)
    read_by: list["Job"] = field(default_factory=list, repr=False)

    def wildcard(self, name: str) -> str | None:
        """The value of a wildcard, of the job's own or of what it reads of the same method."""
        if name in self.wildcards:
            return self.wildcards[name]
        values = (job.wildcard(name) for job in self.reads if job.rule in BY_NAME)
        return next((value for value in values if value is not None), None)

    def sources(self, scripts: dict[str, str]) -> set[Path]:
        """Files that decide what the job makes."""
        if self.rule == "provenance":
            return {*closure(*stages())}
        names = [scripts[self.rule]] if self.rule in scripts else []
        if self.rule in BY_NAME:
            wildcard, module = BY_NAME[self.rule]
            names.append(module(self.wildcard(wildcard)))
        return {*closure(*map(source_file, names))}


def following(first: list[Job]) -> list[Job]:
    """The jobs and all that follow them; a mesh does not wait for the table that says that all files were read."""
    reached, waiting = {}, list(first)
    while waiting:
        job = waiting.pop()
        if id(job) not in reached:
            reached[id(job)] = job
            waiting += [other for other in job.read_by if (job.rule, other.rule) != ("check_cohort", "model_case")]
    return list(reached.values())


@pytest.fixture(scope="module")
def study(studied) -> list[tuple[Job, set[Path]]]:
    """Jobs of the quick study, each with its sources."""
    said = studied.quick("--dag")
    numbered = {}
    for number, label in re.findall(r'^\s*(\d+)\[label = "([^"]*)"', said, re.M):
        rule, *values = label.split("\\n")
        numbered[number] = Job(rule, dict(value.split(": ", 1) for value in values))
    for one, other in re.findall(r"^\s*(\d+) -> (\d+)", said, re.M):
        numbered[other].reads.append(numbered[one])
        numbered[one].read_by.append(numbered[other])
    scripts = scripts_of_rules()
    return [(job, job.sources(scripts)) for job in numbered.values()]


@pytest.mark.parametrize("room", ROOMS)
def test_an_edit_of_a_module_reruns_what_imports_it_and_what_follows(studied, study, room):
    """One module of a room: the one that the fewest jobs import, so that most of the study has to stand."""
    modules = [path for path in (LIBRARY / room).glob("*.py") if path.name != "__init__.py"]
    importing = {path: [job for job, sources in study if path in sources] for path in modules}
    module = min(modules, key=lambda path: (len(importing[path]) < 2, len(importing[path]), path))
    edited = studied.folder / module.relative_to(ROOT)
    text = edited.read_text(encoding="utf-8")
    try:
        edited.write_text(text + "# an edit\n", encoding="utf-8")
        said = studied.quick("--dry-run")
    finally:
        edited.write_text(text, encoding="utf-8")
    expected = Counter(job.rule for job in following(importing[module]))
    assert Counter(jobs(said) if expected else {}) == expected, module
    assert len(expected) or "Nothing to be done" in said
