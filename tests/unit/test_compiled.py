"""Compiled loops that are kept on disk follow the edits of what they import."""

import os
import shutil
import subprocess
import sys

import pytest

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


@pytest.fixture
def package(tmp_path):
    """A library of nothing but what keeps compiled code."""
    package = tmp_path / "workflow/pinnochio"
    package.mkdir(parents=True)
    for name in ("__init__.py", "code.py", "compiled.py"):
        shutil.copy(LIBRARY / name, package / name)
    return package


@pytest.mark.full
def test_kept_code_that_names_a_class_which_is_gone_is_compiled_anew(package, tmp_path):
    for name, hits in (("Pair", 0), ("Pair", 1), ("Two", 0), ("Two", 1)):
        (package / "inner.py").write_text(
            f"from typing import NamedTuple\n\n\nclass {name}(NamedTuple):\n    a: float\n"
        )
        (package / "outer.py").write_text(
            f"from pinnochio.compiled import compiled\nfrom pinnochio.inner import {name}\n\n\n"
            f"@compiled\ndef g(x):\n    return x.a\n\n\ndef f(x):\n    return g({name}(x))\n\n\nf.stats = g.stats\n"
        )
        assert run(tmp_path / "workflow") == (2.0, hits)


def test_an_edit_of_an_imported_module_drops_the_kept_code(package, tmp_path):
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
