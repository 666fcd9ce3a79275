"""The paper's own tables."""

import pandas as pd

from pinnochio.tables.document import Block, View

SOURCE = "clinical cohort, Lee et al. 2026 (arXiv 2606.01572)"
# Table 1 there, whole face, 40 patients: mean and standard deviation; distances in mm, areas in %, times in s.
_TABLE_1 = (
    ("ACMT-Net", 2.19, 0.79, 5.56, 2.35, 36.04, 12.98, 63.59, 14.97, 0.10),
    ("DGCFP", 1.71, 0.62, 4.94, 2.03, 47.28, 12.36, 72.43, 12.18, 0.54),
    ("FEM-RLSE", 1.30, 0.29, 3.16, 0.80, 50.83, 10.97, 80.90, 10.12, 12600),
    ("PINNOCHIO", 1.12, 0.26, 2.73, 0.69, 58.36, 12.60, 86.55, 8.42, 3.24),
)
_MEASURES = [f"{name}_{part}" for name in ("cd", "hd", "pwr1", "pwr2") for part in ("mean", "sd")]
TABLE_1 = pd.DataFrame(_TABLE_1, columns=["method", *_MEASURES, "seconds"])
# Table 2 there: without decomposition, without physics, whole; areas in %, the residual without a unit.
_TABLE_2 = (
    ("without decomposition", 1.04, 0.27, 62.35, 11.74, 0.25, 0.34, 0.86, 0.04),
    ("without physics", 1.02, 0.24, 64.10, 12.63, 1.73, 1.14, 0.68, 0.14),
    ("PINNOCHIO", 0.98, 0.22, 64.88, 11.58, 0.20, 0.34, 0.87, 0.05),
)
_ABLATED = [f"{name}_{part}" for name in ("cd", "pwr1", "eqres", "jacobian") for part in ("mean", "sd")]
TABLE_2 = pd.DataFrame(_TABLE_2, columns=["method", *_ABLATED])
_TITLE = f"The paper's own values: {SOURCE}"
_CAPTION = (
    ", n = 40 patients: mean ± standard deviation. Bold: best mean. Other patients, scans and machines than above: "
    "rows of the two tables are not to be compared one by one."
)
# Names here of the methods of Table 1.
OURS = {"ACMT-Net": "acmt_pretrained", "DGCFP": "dgcfp_pretrained", "FEM-RLSE": "fem_rlse", "PINNOCHIO": "pinnochio"}
# The same of Table 2.
VARIANTS = {
    "without decomposition": "pinnochio_unified",
    "without physics": "pinnochio_no_physics",
    "PINNOCHIO": "pinnochio",
}


def published_block() -> Block:
    """The paper's Table 1 as a block of its own."""
    view = [
        View("Method", lambda row: row["method"]),
        View("CD mm", _spread("cd"), -1),
        View("HD mm", _spread("hd"), -1),
        View("PWR@1 %", _spread("pwr1"), 1),
        View("PWR@2 %", _spread("pwr2"), 1),
        View("Seconds", lambda row: f"{row['seconds']:.2f}".removesuffix(".00"), -1),
    ]
    return Block.of(TABLE_1, view, f"Accuracy in the paper's Table 1{_CAPTION}", _TITLE)


def published_ablation() -> Block:
    """The paper's Table 2 as a block of its own."""
    view = [
        View("Method", lambda row: row["method"]),
        View("CD mm", _spread("cd"), -1),
        View("PWR@1 %", _spread("pwr1"), 1),
        View("EqRes", _spread("eqres"), -1),
        View("min J", _spread("jacobian"), 1),
    ]
    return Block.of(TABLE_2, view, f"Ablation in the paper's Table 2; it gives no unit of EqRes{_CAPTION}", _TITLE)


def _spread(name: str):
    return lambda row: f"{row[f'{name}_mean']:.2f} ± {row[f'{name}_sd']:.2f}"
