"""On a finished study, an edit of a module reruns what its scripts import, and what follows; nothing else."""

import re
from collections import defaultdict

import pytest

from pinnochio.code import LIBRARY, ROOT, closure, source_file
from pinnochio.methods.registry import BUILT_IN, GRAPH_NETWORK, SURFACE_NETWORK
from tests.helpers.study import jobs

QUICK = ("--configfile", "config/quick.yaml")
ROOMS = sorted(path.parent.relative_to(LIBRARY).as_posix() for path in LIBRARY.rglob("__init__.py"))
LEARNERS = [GRAPH_NETWORK.module, SURFACE_NETWORK.module]
MODULES = {
    "pretrain": LEARNERS,
    "finetune": LEARNERS,
    "fit": [method.module for method in BUILT_IN if method.trains == "at once"],
    "predict_cases": [*LEARNERS, *(method.module for method in BUILT_IN)],
    "predict_ensemble": LEARNERS,
}  # of methods, which these rules' scripts import by name


def scripts() -> dict[str, str]:
    """Script of each rule, from the rules' text."""
    by_rule = {}
    for file in ROOT.glob("rules/*.smk"):
        blocks = re.split(r"^rule (\w+):\n", file.read_text(), flags=re.M)
        for rule, body in zip(blocks[1::2], blocks[2::2], strict=True):
            if script := re.search(r'"\.\./scripts/(\w+)\.py"', body):
                by_rule[rule] = script[1]
    return by_rule


def following(edges: dict[str, set[str]], rules: set[str]) -> set[str]:
    """The rules and all that follow them."""
    reached, waiting = set(), list(rules)
    while waiting:
        if (rule := waiting.pop()) not in reached:
            reached.add(rule)
            waiting += edges[rule]
    return reached


@pytest.fixture(scope="module")
def edges(studied) -> dict[str, set[str]]:
    """Rules of the quick study, and those that read what each of them makes."""
    said = studied.snakemake(*QUICK, "--rulegraph").stdout
    names = dict(re.findall(r'^\s*(\d+)\[label = "(\w+)', said, re.M))
    edges = defaultdict(set, {name: set() for name in names.values()})
    for one, other in re.findall(r"^\s*(\d+) -> (\d+)", said, re.M):
        edges[names[one]].add(names[other])
    return edges


@pytest.mark.parametrize("room", ROOMS)
def test_an_edit_of_a_module_reruns_what_imports_it_and_what_follows(studied, edges, room):
    """One module of every room: the one that the fewest scripts import, so that most of the study has to stand."""
    reach = {rule: {*closure(source_file(script))} for rule, script in scripts().items()}
    for rule, modules in MODULES.items():
        reach[rule] |= {*closure(*map(source_file, modules))}
    modules = [path for path in (LIBRARY / room).glob("*.py") if path.name != "__init__.py"]
    importing = {path: {rule for rule, files in reach.items() if path in files} for path in modules}
    module = min(modules, key=lambda path: (not importing[path] & set(edges), len(importing[path]), path))
    expected = following(edges, importing[module] & set(edges))
    edited = studied.folder / module.relative_to(ROOT)
    text = edited.read_text(encoding="utf-8")
    edited.write_text(text + "# an edit\n", encoding="utf-8")
    said = studied.quick("--dry-run")
    edited.write_text(text, encoding="utf-8")
    assert set(jobs(said) if expected else []) == expected, module
    if not expected:
        assert "Nothing to be done" in said


def test_a_configuration_without_an_edit_reruns_nothing(studied):
    assert "Nothing to be done" in studied.quick("--dry-run")
