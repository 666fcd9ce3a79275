"""What the tests share stands in `tests/helpers`; a stage script's main maps the job to its function by keyword."""

import ast
import re
from pathlib import Path

import pytest

from pinnochio.code import ROOT, closure, source_file
from tests.helpers.rules import RULE_FILES, bodies, dotted, scripts_of_rules
from tests.helpers.sources import imported

TESTS = Path(__file__).resolve().parents[1]
CODE = re.compile(r'code=(?:lambda wildcards: )?code_(?:of|with_method)\(\s*"([\w.]+)"|code=code_hash\(\*stages\(\)\)')
MODULES = sorted([*TESTS.rglob("test_*.py"), *TESTS.rglob("conftest.py"), *(TESTS / "helpers").glob("*.py")])


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_test_module_is_imported(path):
    for name in imported(path):
        first, *rest = name.split(".")
        assert not first.startswith(("test_", "conftest")), name
        assert first != "tests" or rest[0] == "helpers", name


def test_names_of_test_modules_are_unique():
    names = [path.name for path in (TESTS / "unit").rglob("test_*.py")]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", sorted({*scripts_of_rules().values()}))
def test_the_main_of_a_script_passes_every_argument_by_keyword(name):
    """A swapped path would be silent otherwise; logging comes first."""
    tree = ast.parse(source_file(name).read_text(encoding="utf-8"))
    (main,) = [node for node in tree.body if isinstance(node, ast.If)]
    assert ast.unparse(main.body[0]) == "attach_log(snakemake.log[0])"
    public = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    calls = [node for node in ast.walk(main) if isinstance(node, ast.Call) and ast.unparse(node.func) in public]
    assert calls and not any(call.args for call in calls)


def test_every_stage_script_is_run_by_a_rule():
    stages = {dotted(path) for path in (ROOT / "scripts").rglob("*.py") if path.name != "__init__.py"}
    run = {path for name in scripts_of_rules().values() for path in closure(source_file(name))}
    assert stages <= {dotted(path) for path in run if path.suffix == ".py"}


@pytest.mark.parametrize("path", RULE_FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_rule_carries_the_hash_of_its_script(path):
    for rule, body in bodies(path).items():
        if script := scripts_of_rules().get(rule):
            hashed = re.search(CODE, body)
            assert hashed and hashed[1] in (script, None), rule
