"""The table of the stability sweep: one row per cell, in the twins counted by family and method."""

from collections.abc import Mapping, Sequence

import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.tables.document import Block, Table, View

# In the eyes of an independent judge.
CONVERGED, CLEAN, WRONG = "converged", "failed cleanly", "wrong"
OUTCOMES = (CONVERGED, CLEAN, WRONG)
# What is taken to its extreme, and the unit of its settings.
FAMILIES = {
    "translation": "mm",
    "rotation": "deg",
    "poisson": "-",
    "stiffness": "-",
    "dihedral": "deg",
    "inverted": "%",
    "unit": "mm",
}
STABILITY = (
    Column("family", str, "", f"what is taken to its extreme: {', '.join(FAMILIES)}"),
    Column("setting", float, "", "how far", "g"),
    Column("unit", str, "", "unit of the setting, - without one"),
    Column("method", str, "", "solver, elastic (linear path) or loss (physics loss and its gradient)"),
    Column("element", str, "", "volume term"),
    Column("precision", str, "", "of the arrays handed over; the loss computes in it, the solvers in float64"),
    Column(
        "outcome", str, "", "converged and confirmed, failed cleanly, or wrong, in the eyes of an independent judge"
    ),
    Column("reason", str, "", "why"),
    number("min_jacobian", "", "smallest det F of the state"),
    number("residual", "", "relative force on free unknowns; of the loss, its largest error", ".1e"),
    Column("seconds", float, "s", "of the method, without the judge", ".3f"),
    Column("case", str, "", "patient, or block"),
    Column("seed", int, "", "seed of the study"),
    Column("device", str, "", "device that computed"),
    Column("code", str, "", "content hash of the code"),
)


def label(setting: float, unit: str) -> str:
    """A setting with its unit."""
    return f"{setting:g} {unit}".removesuffix(" -")


def check_outcomes(frame: pd.DataFrame) -> None:
    """RuntimeError that names every wrong cell, if there is one."""
    wrong = frame[frame["outcome"] == WRONG]
    if len(wrong):
        cells = [
            f"{row.family} {label(row.setting, row.unit)}, {row.method} {row.element} {row.precision}: {row.reason}"
            for row in wrong.itertuples()
        ]
        raise RuntimeError(f"{len(cells)} of {len(frame)} cells are wrong:\n" + "\n".join(cells))


def table(rows: Sequence[Mapping]) -> Table:
    """The table of the sweep's rows; RuntimeError if a cell is wrong."""
    frame = check(pd.DataFrame(rows), STABILITY)
    check_outcomes(frame)
    form = {column.name: column for column in STABILITY}
    groups = []
    for (family, method), own in frame.groupby(["family", "method"], sort=False):
        done, failed = own[own["outcome"] == CONVERGED], own[own["outcome"] == CLEAN]
        settings = own.drop_duplicates("setting")
        ends = [f"{label(row.setting, row.unit)} {row.element} {row.precision}" for row in failed.itertuples()]
        groups.append(
            {
                "Family": family,
                "Settings": ", ".join(label(row.setting, row.unit) for row in settings.itertuples()),
                "Method": method,
                **{outcome: int((own["outcome"] == outcome).sum()) for outcome in OUTCOMES},
                "Least J": form["min_jacobian"].text(done["min_jacobian"].min()),
                "Largest residual or error": form["residual"].text(done["residual"].max()),
                "Failed cleanly at": ", ".join(ends),
            }
        )
    view = [View(header, lambda row, header=header: row[header]) for header in groups[0]]
    caption = (
        f"Stability sweep: {len(frame)} cells, each judged independently of what it judges. Least J and residual are "
        "those of the converged cells; the elastic path is linear, and the loss is taken at a raw network's state, so "
        "that their J may be negative."
    )
    return Table(frame, STABILITY, [Block.of(pd.DataFrame(groups), view, caption)])
