"""Every module and every key of the configuration has a user: a rule's script or a person's command, not a test.

That every rule is planned by a documented command stands in test_commands.py, which plans them.
"""

import ast
import re
from pathlib import Path

from pinnochio.code import CALL, IMPORT, PACKAGES, ROOT, TEXT, closure, source_file
from pinnochio.study.schema import read_schema, resolved
from tests.helpers.rules import scripts_of_rules

COMMANDS = [*sorted((ROOT / "workflow").glob("*.py")), ROOT / "slicer/FacePrediction.py"]
SNAKEFILES = [ROOT / "Snakefile", *ROOT.glob("workflow/*.smk"), *ROOT.glob("rules/*.smk")]
SNAKEFILES += ROOT.glob("workflow/studies/*/*.smk")
MODULES = {path for folder in PACKAGES.values() for path in folder.rglob("*.py") if path.name != "__init__.py"}


def entries() -> set[Path]:
    """Files that rules run, import or name: scripts, modules by their dotted names, tables and figures by their own."""
    files = {source_file(name) for name in scripts_of_rules().values()}
    for file in SNAKEFILES:
        text, names = file.read_text(encoding="utf-8"), set()
        for module, imported in IMPORT.findall(text):
            names |= {module, *(f"{module}.{name.strip()}" for name in imported.strip("()").split(","))}
        for word in TEXT.findall(text):
            names |= {match[1] for match in [CALL.fullmatch(word)] if match}
            names |= {f"pinnochio.tables.{word}", f"studies.{word}.figure"}
        paths = [(PACKAGES[first], rest) for first, *rest in (name.split(".") for name in names) if first in PACKAGES]
        files |= {folder.joinpath(*rest).with_suffix(".py") for folder, rest in paths if rest}
    return files & MODULES


def words(path: Path) -> set[str]:
    """Strings that a Python file holds, and its names of arguments, fields and attributes; all words of a rule file."""
    text, names = path.read_text(encoding="utf-8"), set()
    if path.suffix != ".py":
        return {*re.findall(r"\w+", text)}
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Constant(value=str(name)) if name.isidentifier():
                names.add(name)
            case ast.Attribute(attr=name) | ast.arg(arg=name) | ast.keyword(arg=str(name)):
                names.add(name)
            case ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
    return names


def keys(node: dict, schema: dict, prefix: str = "") -> set[str]:
    """Keys of the configuration with those that they stand in, joined by dots."""
    names = set()
    for key, entry in resolved(node, schema).get("properties", {}).items():
        names |= {f"{prefix}{key}"} | keys(entry, schema, f"{prefix}{key}.")
    return names


def test_every_module_is_reached_from_a_rule_or_a_command():
    unused = MODULES.difference(closure(*entries(), *COMMANDS))
    assert not {path.relative_to(ROOT).as_posix() for path in unused}


def test_every_key_of_the_configuration_is_read():
    read = set().union(*map(words, [*MODULES, *COMMANDS, *SNAKEFILES]))
    schema = read_schema(ROOT)
    assert not {key for key in keys(schema, schema) if key.rpartition(".")[2] not in read}
