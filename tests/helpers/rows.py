"""Rows of tables and benchmark files with numbers made up."""

import numpy as np

from pinnochio.metrics.case_columns import CASES


def row(case, method, cd, **more):
    values = dict.fromkeys((c.name for c in CASES if c.optional), np.nan) | {"reason": "", "eqres_element": "patch"}
    values |= {"case": case, "method": method, "fold": "1", "seed": 1, "device": "cpu", "code": "abc", "cd": cd}
    values |= {"hd95": 3 * cd, "pwr1": 60 - cd, "pwr2": 80 - cd, "seconds": 1.0, "setup_seconds": 0.5, "threads": 1}
    values |= {"muscle": "labelled", "nodes": 5000, "converged": True, "inverted": 2, "min_jacobian": 0.9}
    return values | {"eqres_rel": 1e-7} | more


HEADER = "s\th:m:s\tmax_rss\tmax_vms\tmax_uss\tmax_pss\tio_in\tio_out\tmean_load\tcpu_time"


def benchmark(path, seconds, cpu, memory):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{HEADER}\n{seconds}\t0:00:01\t{memory}\t9\t9\t9\t0\t0\t50\t{cpu}\n")
    return path
