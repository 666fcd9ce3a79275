"""What the tests share stands in `tests/helpers`; a stage script's main maps the job to its function by keyword."""

import ast
import re
from pathlib import Path

import pytest

from tests.helpers.sources import imported

TESTS = Path(__file__).resolve().parents[1]
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


@pytest.mark.parametrize("path", sorted((TESTS.parent / "scripts").glob("[a-z]*.py")), ids=lambda path: path.stem)
def test_the_main_of_a_script_passes_every_argument_by_keyword(path):
    """A swapped path would be silent otherwise; logging comes first."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    (main,) = [node for node in tree.body if isinstance(node, ast.If)]
    assert ast.unparse(main.body[0]) == "attach_log(snakemake.log[0])"
    own = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    calls = [node for node in ast.walk(main) if isinstance(node, ast.Call) and ast.unparse(node.func) in own]
    assert calls and not any(call.args for call in calls)


@pytest.mark.parametrize("path", sorted((TESTS.parent / "rules").glob("*.smk")), ids=lambda path: path.stem)
def test_every_rule_carries_the_hash_of_its_own_script(path):
    for body in re.split(r"^rule ", path.read_text(encoding="utf-8"), flags=re.M)[1:]:
        if script := re.search(r'"\.\./scripts/(\w+)\.py"', body):
            hashed = re.findall(
                r'code=(?:lambda wildcards: )?code_(?:of|with_method)\(\s*"(\w+)"|code=code_of\((\*)', body
            )
            assert hashed in ([(script[1], "")], [("", "*")]), body.split(":")[0]
