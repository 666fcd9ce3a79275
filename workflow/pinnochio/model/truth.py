"""The truth of a virtual patient: where all of the tissue went, and how the plan was carried out."""

import os

import numpy as np

from pinnochio.hdf5 import reading
from pinnochio.plans.plan import Plan


def read_truth(path: str | os.PathLike, case: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, Plan]:
    """Points (n, 3) mm, cells (m, 4), displacement (n, 3) mm and the executed plan of a simulated outcome.

    Evaluation and the bounds read them, no method does.
    """
    with reading(path) as file:
        field = (file[name][()] for name in ("points", "cells", "displacement"))
        return *field, Plan.from_json(file.attrs["executed"], path, case)
