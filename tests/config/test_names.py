"""Names of the project's code are the field's words, and classes, functions and pages keep to their budgets."""

import ast
import builtins
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from tests.helpers.documents import FENCE, PAGES
from tests.helpers.settings import ROOT

REFUSED = {"own", "told", "asked", "found", "given", "bend", "loud", "eased"}  # parts between underscores, any case
REFUSED_WORDS = re.compile(r"(?<![a-z])(put_back)(?![a-z])|(?:^|_|(?<=[a-z0-9]))(Way|Told|Asked)(?![a-z])")
STANDARD = {"Path", "Counter", "Enum", "Event", "Process", "Queue", "Thread", "Lock", "Random", "Logger", "Decimal"}
STANDARD |= {"Fraction", "Mapping", "Sequence", "Iterable", "Iterator", "Callable", "Any", *vars(builtins)}
MEMBERS, LINES, WORDS = 30, 80, 100
PAGE_WORDS, ALL_WORDS, TABLES = 800, 30_000, 1  # as `wc -w` counts; lines of dashes below the head of a table
SHIPPED = [path for folder in ("workflow", "scripts") for path in sorted((ROOT / folder).rglob("*.py"))]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
TEXTS = [page for page in PAGES if "lab" not in page.relative_to(ROOT).parts]
LISTS = {"config/README.md", "docs/reference/columns.md", "docs/reference/glossary.md"}  # looked up, not read
FUNCTION = ast.FunctionDef | ast.AsyncFunctionDef


def short(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def identifiers(path: Path) -> set[str]:
    """Names that a file defines or binds: variables, arguments, functions, classes, attributes, aliases."""
    names = set()
    for node in nodes(path):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name) | ast.alias(asname=str(name)):
                names.add(name)
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                names.add(name)
    return names


def refused(name: str) -> bool:
    return bool(REFUSED.intersection(name.lower().split("_")) or REFUSED_WORDS.search(name))


def members(node: ast.ClassDef) -> set[str]:
    """Names of a class: methods, fields and constants."""
    names = set()
    for child in node.body:
        match child:
            case ast.FunctionDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
            case ast.Assign(targets=targets):
                names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return names


def length(node: FUNCTION) -> int:
    return node.end_lineno - node.lineno + 1


def is_kernel(node: FUNCTION) -> bool:
    """Whether Numba or Triton compiles the function or what it holds, where a call costs."""
    decorated = [deco for child in ast.walk(node) if isinstance(child, FUNCTION) for deco in child.decorator_list]
    return any(re.search(r"jit|intrinsic|overload|vectorize", ast.unparse(deco)) for deco in decorated)


def paragraphs(page: Path) -> list[str]:
    """Paragraphs of a page and items of its lists; no code, tables or comments."""
    text = re.sub(r"<!--.*?-->", "", FENCE.sub("\n\n", page.read_text(encoding="utf-8")), flags=re.S)
    text = re.sub(r"^( *(?:[*-]|\d+\.) )", r"\n\n\1", text, flags=re.M)
    blocks = (block for block in re.split(r"\n\s*\n", text) if not block.startswith(("    ", "#")))
    return ["\n".join(line for line in block.splitlines() if not line.lstrip().startswith("|")) for block in blocks]


def broken(rule: str) -> dict[str, list[str]]:
    """What breaks a rule, by file."""
    offences = defaultdict(list)
    if rule == "identifiers":
        for path in SHIPPED + TESTS:
            offences[short(path)] += sorted(filter(refused, identifiers(path)))
    elif rule == "paragraphs":
        for page in TEXTS:
            offences[short(page)] += [text[:60] for text in paragraphs(page) if len(text.split()) > WORDS]
    elif rule == "twice":
        homes = defaultdict(list)
        for path in SHIPPED:
            for node in nodes(path):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    homes[node.name].append(short(path))
        for name, files in homes.items():
            for file in files if len(files) > 1 else ():
                offences[file].append(name)
    else:
        for path in SHIPPED:
            top = ast.parse(path.read_text(encoding="utf-8")).body
            for node in nodes(path) if rule != "standard" else top:
                if rule == "standard" and isinstance(node, FUNCTION | ast.ClassDef) and node.name in STANDARD:
                    offences[short(path)].append(node.name)
                elif rule == "members" and isinstance(node, ast.ClassDef) and len(members(node)) > MEMBERS:
                    offences[short(path)].append(f"{node.name} {len(members(node))}")
                elif rule == "lines" and isinstance(node, FUNCTION) and length(node) > LINES and not is_kernel(node):
                    offences[short(path)].append(f"{node.name} {length(node)}")
    return {file: names for file, names in offences.items() if names}


@pytest.mark.parametrize("rule", ["identifiers", "twice", "standard", "members", "lines", "paragraphs"])
def test_names_and_sizes(rule):
    assert not broken(rule)


@pytest.mark.parametrize("page", TEXTS, ids=short)
def test_a_page_is_short_and_has_one_table(page):
    """The README has two: what to type, and what came out."""
    text = page.read_text(encoding="utf-8")
    if short(page) not in LISTS:
        assert len(text.split()) <= PAGE_WORDS
        assert len(re.findall(r"^\|[ :|-]+\|$", text, re.M)) <= TABLES + (short(page) == "README.md")


def test_all_pages_can_be_read_in_a_day():
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in TEXTS) <= ALL_WORDS


def test_names_of_the_old_dialect_are_refused_and_those_that_only_hold_the_letters_are_not():
    assert all(map(refused, ["own", "of_own_fold", "TOLD", "put_back", "Way", "_loud", "OneWay", "asked_for"]))
    assert not any(map(refused, ["owner", "unknown", "foundation", "wayward", "Highway", "bending", "give"]))
