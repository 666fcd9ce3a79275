"""What the tests share stands in `tests/helpers`: no test module imports another, nor a conftest."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
MODULES = sorted([*TESTS.rglob("test_*.py"), *TESTS.rglob("conftest.py"), *(TESTS / "helpers").glob("*.py")])


def imported(path: Path) -> set[str]:
    """Full names of all that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{name.name}" for name in node.names}
    return names


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_test_module_is_imported(path):
    for name in imported(path):
        first, *rest = name.split(".")
        assert not first.startswith(("test_", "conftest")), name
        assert first != "tests" or rest[0] == "helpers", name


def test_names_of_test_modules_are_unique():
    names = [path.name for path in (TESTS / "unit").rglob("test_*.py")]
    assert len(names) == len(set(names))
