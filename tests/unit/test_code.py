"""Code hashes cover what a script really imports, and nothing else."""

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

from pinnochio import code
from pinnochio.code import ROOT, closure, code_hash, source_file, stages
from tests.helpers.rules import dotted

SCRIPTS = stages()
NAMES = [dotted(path) for path in SCRIPTS]
# Imports every script, and says which of the project's files each of them names as it is imported.
LOADED = """
import builtins, json, sys
packages, named, plain = ("pinnochio", "scripts", "studies"), {}, builtins.__import__


def noted(name, globals=None, locals=None, fromlist=(), level=0):
    module = plain(name, globals, locals, fromlist, level)
    file = (globals or {}).get("__file__")
    if name.split(".")[0] in packages and file:
        names = [name, *(f"{name}.{part}" for part in fromlist or ())]
        files = (getattr(sys.modules.get(each), "__file__", None) for each in names)
        named.setdefault(file, set()).update(filter(None, files))
    return module


builtins.__import__ = noted
for script in sys.argv[1:]:
    __import__(script)
print(json.dumps({file: sorted(files) for file, files in named.items()}))
"""


def test_what_a_file_is_hashed_with_holds_all_that_its_import_names():
    """Of every script and of all that it imports, so that the closure of a script holds what it loads."""
    paths = {"PYTHONPATH": f"{ROOT / 'workflow'}:{ROOT}", "PATH": "/usr/bin:/bin", "HOME": "/tmp"}
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *NAMES], env=paths, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    named = {Path(file): set(map(Path, files)) for file, files in json.loads(done.stdout.splitlines()[-1]).items()}
    assert len(named) > 200 and not [path for path in SCRIPTS if len(closure(path)) > 2 and path not in named]
    for file, files in named.items():
        if ROOT in file.parents:
            assert files <= code.imported_by(file), file


def test_an_edit_changes_the_hashes_of_the_scripts_that_reach_it_and_of_no_other(monkeypatch):
    before = {script: code_hash(script) for script in SCRIPTS}
    module = source_file("pinnochio.mechanics.elements.materials")
    read = type(module).read_bytes
    monkeypatch.setattr(type(module), "read_bytes", lambda path: read(path) + b"#" * (path == module))
    changed = {script for script in SCRIPTS if code_hash(script) != before[script]}
    assert changed == {script for script in SCRIPTS if module in closure(script)}
    assert 5 < len(changed) < len(SCRIPTS) - 5


def write(folder, files):
    """A library in the folder: text of each file by its path."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def placed(monkeypatch, root):
    """Makes the library of the folder the project's, and forgets where modules were."""
    monkeypatch.setattr(code, "PACKAGES", {"pinnochio": root / "pinnochio"})
    monkeypatch.setattr(code, "_files", cache(code._files.__wrapped__))


def test_imports_of_every_form_are_followed(tmp_path, monkeypatch):
    write(
        tmp_path / "pinnochio",
        {
            "a.py": "import pinnochio.b\n",
            "b.py": "def later():\n    from pinnochio.room import c\n",
            "room/__init__.py": "from os import path\n",
            "room/page.html": "",
            "room/c.py": "PAGE = 'page.html', 'no_page.html'\n"
            "CALL = 'pinnochio.room.d:call'\nTEXT = 'pinnochio.room.e is only named'\n",
            "room/d.py": "",
            "room/e.py": "",
        },
    )
    placed(monkeypatch, tmp_path)
    monkeypatch.setattr(code, "ROOT", tmp_path)
    files = closure(tmp_path / "pinnochio/a.py")
    names = {path.relative_to(tmp_path / "pinnochio").as_posix() for path in files}
    assert names == {"a.py", "b.py", "room/__init__.py", "room/c.py", "room/d.py", "room/page.html"}


def test_the_hash_does_not_depend_on_where_the_project_lies(tmp_path, monkeypatch):
    hashes = []
    for place in ("one", "two"):
        write(tmp_path / place / "pinnochio", {"a.py": "from pinnochio.b import x\n", "b.py": "x = 1\n"})
        placed(monkeypatch, tmp_path / place)
        monkeypatch.setattr(code, "ROOT", tmp_path / place)
        hashes.append(code_hash(tmp_path / place / "pinnochio/a.py"))
    assert hashes[0] == hashes[1]
    (tmp_path / "two/pinnochio/b.py").write_text("x = 2\n")
    assert code_hash(tmp_path / "two/pinnochio/a.py") != hashes[0]
