"""Compiled loops that are kept on disk follow the edits of what they import."""

import os
import shutil
import subprocess
import sys

from pinnochio.code import LIBRARY


def run(folder) -> tuple[float, int]:
    """Result of the compiled function in a process of its own, and how often it was read from the disk."""
    call = "from pinnochio.outer import f; print(f(2.0), sum(f.stats.cache_hits.values()))"
    done = subprocess.run(
        [sys.executable, "-c", call],
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    result, hits = done.stdout.split()
    return float(result), int(hits)


def test_an_edit_of_an_imported_module_drops_the_kept_code(tmp_path):
    package = tmp_path / "workflow/pinnochio"
    package.mkdir(parents=True)
    for name in ("__init__.py", "code.py", "compiled.py"):
        shutil.copy(LIBRARY / name, package / name)
    (package / "inner.py").write_text("FACTOR = 2.0\n")
    (package / "outer.py").write_text(
        "from pinnochio.compiled import compiled\nfrom pinnochio.inner import FACTOR\n\n\n"
        "@compiled\ndef f(x):\n    return FACTOR * x\n"
    )
    assert run(tmp_path / "workflow") == (4.0, 0)
    assert run(tmp_path / "workflow") == (4.0, 1)
    (package / "inner.py").write_text("FACTOR = 3.0\n")
    assert run(tmp_path / "workflow") == (6.0, 0)
    assert run(tmp_path / "workflow") == (6.0, 1)
