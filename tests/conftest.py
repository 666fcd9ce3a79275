"""Puts the library and the stage scripts on the import path, as Snakemake does."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
for folder in (ROOT / "workflow", ROOT):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
