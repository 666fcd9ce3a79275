"""Puts the library and the stage scripts on the import path, and sets threads as the workflow does."""

import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # spinning they take the cores from tests that run beside them
os.environ.setdefault("OMP_NUM_THREADS", "1")  # two suites fill two cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a second thread spins: up to four times the processor time
ROOT = Path(__file__).resolve().parent.parent
for folder in (ROOT / "workflow", ROOT):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
