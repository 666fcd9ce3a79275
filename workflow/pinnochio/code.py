"""Content hashes of source files together with all that they import of the project."""

import hashlib
import os
import re
from functools import cache
from pathlib import Path

LIBRARY = Path(__file__).resolve().parent
ROOT = LIBRARY.parents[1]
PACKAGES = {"pinnochio": LIBRARY, "scripts": ROOT / "scripts", "studies": ROOT / "workflow/studies"}
# By text: a syntax tree of every module takes longer than all else that Snakemake does before it runs a job.
IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+)?import[ \t]+(\([^)]*\)|[^\n#]*)", re.MULTILINE)
TEXT = re.compile(r"""["']([\w./:]+)["']""")
# A call named by a string, as what is run in a process of its own is, e.g. scripts.patient.tetrahedralize:mesh_case.
CALL = re.compile(r"((?:pinnochio|scripts|studies)(?:\.\w+)+)(?::\w+)?")
# A data file beside the module that names it.
DATA = re.compile(r"[\w/]+\.(?:html|js|css|md|tex|json|npz)(?:\.j2)?")


def code_hash(*files: str | os.PathLike) -> str:
    """Short content hash of the files and of every module of the project that they import, directly or through others.

    It depends on the files' paths within the project, not on where that lies.
    """
    digest = hashlib.sha256()
    for path in closure(*files):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def closure(*files: str | os.PathLike) -> list[Path]:
    """The files and the project's own modules that they import, transitively, in order of their paths."""
    reached, waiting = set(), [Path(file).resolve() for file in files]
    while waiting:
        file = waiting.pop()
        if file not in reached:
            reached.add(file)
            waiting += imported_by(file)
    return sorted(reached)


def stages() -> list[Path]:
    """Files of every stage script, those of the studies and their modules included."""
    return sorted(path for name in ("scripts", "studies") for path in PACKAGES[name].glob("*/[a-z]*.py"))


def source_file(name: str) -> Path:
    """File of a stage script, or of a module, by the dotted name that an import has, or of a `module:name`."""
    *_, file = _files(name.partition(":")[0])
    return file


@cache
def imported_by(file: Path) -> frozenset[Path]:
    """Files that the Python file names: modules of the project in an import or a call's string, data beside it."""
    if file.suffix != ".py":
        return frozenset()
    source = file.read_text(encoding="utf-8")
    modules, data = set(), {file.parent / text for text in TEXT.findall(source) if DATA.fullmatch(text)}
    for module, names in IMPORT.findall(source):
        names = re.findall(r"[\w.]+", names)
        modules |= {module, *(f"{module}.{name}" for name in names)} if module else {*names}
    return frozenset({*filter(Path.is_file, data), *called(source)}.union(*map(_files, modules)))


def called(text: str) -> set[Path]:
    """Files of the modules that quoted words of a text name for a call."""
    names = filter(None, map(CALL.fullmatch, TEXT.findall(text)))
    return {path for name in names for path in _files(name[1])}


@cache
def _files(module: str) -> tuple[Path, ...]:
    """The file of a module of the project, and those of the packages that it lies in."""
    package, *parts = module.split(".")
    if package not in PACKAGES:
        return ()
    path, files = PACKAGES[package], []
    for part in ["", *parts]:
        path = path / part
        if (path / "__init__.py").is_file():
            files.append(path / "__init__.py")
        elif path.with_suffix(".py").is_file():
            files.append(path.with_suffix(".py"))
    return tuple(files)
