"""Puts the library and the stage scripts on the import path, as Snakemake does."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
for folder in (ROOT / "workflow", ROOT):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items):
    """Tests that share something costly run in one process: those of a finished study, of a folder, of a file."""
    for item in items:
        folder = item.path.parent.name
        shared = "study" if "studied" in item.fixturenames else folder if folder == "stages" else item.path.name
        item.add_marker(pytest.mark.xdist_group(shared))
