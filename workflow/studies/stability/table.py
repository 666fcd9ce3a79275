"""The table of the stability sweep: one row per cell, in the twins counted by family and method, and the envelope."""

import os
from collections.abc import Sequence

import pandas as pd

from pinnochio.columns import Column, number, read_tables
from pinnochio.tables.document import Block, Table, View

# In the eyes of an independent judge.
CONVERGED, CLEAN, WRONG = "converged", "failed cleanly", "wrong"
OUTCOMES = (CONVERGED, CLEAN, WRONG)
# What is taken to its extreme, and the unit of its settings.
FAMILIES = {
    "translation": "mm",
    "rotation": "deg",
    "rough": "mm",
    "poisson": "-",
    "stiffness": "-",
    "dihedral": "deg",
    "inverted": "%",
    "unit": "mm",
    "size": "nodes",
}
OF_PATIENTS = ("translation", "rotation", "rough")  # the others are of the block
KEY = ["family", "case", "way", "segment", "setting", "method", "element", "precision"]
STABILITY = (
    Column("family", str, "", f"what is swept: {', '.join(FAMILIES)}"),
    Column("setting", float, "", "how far", "g"),
    Column("unit", str, "", "unit of the setting, - without one"),
    Column("way", str, "", "direction or axis of a motion, - without one"),
    Column("segment", str, "", "what moves, - of the block or if all do"),
    Column("method", str, "", "what is swept: see docs/lab/stability.md"),
    Column("element", str, "", "volume term"),
    Column("precision", str, "", "of the arrays handed over; the map computes in it, solvers in float64"),
    Column("outcome", str, "", "converged and confirmed, failed cleanly, or wrong by an independent assembly"),
    Column("reason", str, "", "why"),
    number("min_jacobian", "", "smallest det F of the state"),
    number("residual", "", "relative force on free unknowns", ".1e"),
    Column("marked", bool, "", "wrong, and `predict` calls such a field not usable"),
    Column("seconds", float, "s", "time of the method, without the check", ".3f"),
    Column("case", str, "", "patient, or block"),
    Column("seed", int, "", "seed of the study"),
    Column("device", str, "", "device that computed"),
    Column("code", str, "", "content hash of the code"),
)


def label(setting: float, unit: str) -> str:
    """A setting with its unit."""
    return f"{setting:g} {unit}".removesuffix(" -")


def unmarked(frame: pd.DataFrame) -> list[str]:
    """Every wrong cell that nothing warns of, in words."""
    rows = frame[(frame["outcome"] == WRONG) & ~frame["marked"].astype(bool)]
    return [
        f"{row.family} {label(row.setting, row.unit)} {row.way} {row.segment}, {row.case}, "
        f"{row.method} {row.element} {row.precision}: {row.reason}"
        for row in rows.itertuples()
    ]


def tabulate(parts: Sequence[str | os.PathLike]) -> Table:
    """The table of the sweep's parts, wrong cells and all."""
    return table(read_tables(parts, STABILITY))


def table(frame: pd.DataFrame) -> Table:
    """The table of all cells: counts by family and method, and how far each method may go."""
    order = {name: place for place, name in enumerate(FAMILIES)}
    frame = frame.sort_values(
        KEY, key=lambda group: group.map(order) if group.name == "family" else group, kind="stable"
    )
    frame = frame.reset_index(drop=True)
    form = {column.name: column for column in STABILITY}
    groups = []
    for (family, method), group in frame.groupby(["family", "method"], sort=False):
        done = group[group["outcome"] == CONVERGED]
        settings = group.drop_duplicates("setting").sort_values("setting")
        groups.append(
            {
                "Family": family,
                "Settings": ", ".join(label(row.setting, row.unit) for row in settings.itertuples()),
                "Method": method,
                **{outcome: int((group["outcome"] == outcome).sum()) for outcome in OUTCOMES},
                "Least J": form["min_jacobian"].text(done["min_jacobian"].min()),
                "Largest residual": form["residual"].text(done["residual"].max()),
                "Failed cleanly at": ends(group[group["outcome"] == CLEAN]),
                "Wrong at": ends(group[group["outcome"] == WRONG]),
            }
        )
    counts = frame["outcome"].value_counts()
    said = ", ".join(f"{counts.get(outcome, 0)} {outcome}" for outcome in OUTCOMES)
    caption = (
        f"Stability sweep: {len(frame)} cells, each judged independently of what it judges: {said}. Least J and "
        "residual are those of the converged cells; elastic path and map are linear, so that their J may be negative."
    )
    reach = (
        "How far every cell of every patient, segment and direction converged, was confirmed and has no element inside "
        "out. Beyond, some cells have some, failed cleanly or are wrong; the last column says of how many cells of the "
        "next setting all is well."
    )
    blocks = [Block.of(pd.DataFrame(groups), shown(groups), caption)]
    if reach_rows := envelope(frame):
        blocks.append(Block.of(pd.DataFrame(reach_rows), shown(reach_rows), reach, "Envelope"))
    return Table(frame, STABILITY, blocks, wrong_in_words(frame))


def shown(rows: Sequence[dict]) -> list[View]:
    """Views of rows as they are."""
    return [View(header, lambda row, header=header: row[header]) for header in rows[0]]


def ends(group: pd.DataFrame) -> str:
    """Settings of some cells, and how many there are at each."""
    counts = group.groupby(["setting", "unit"]).size()
    return ", ".join(f"{label(setting, unit)} ({count})" for (setting, unit), count in counts.items())


def envelope(frame: pd.DataFrame) -> list[dict]:
    """Of each method that makes a field and each family that moves segments: the largest setting up to which every
    cell converged to a field that tissue could have."""
    reach_rows = []
    moved = frame[frame["family"].isin(OF_PATIENTS)]
    moved = moved.assign(good=(moved["outcome"] == CONVERGED) & ~(moved["min_jacobian"] <= 0))
    for (method, family), group in moved.groupby(["method", "family"], sort=False):
        shares = group.groupby("setting")["good"]
        share, unit = shares.mean(), group["unit"].iloc[0]
        bad = share[share < 1]
        below = share[share.index < bad.index.min()] if len(bad) else share
        beyond = ""
        if len(bad):
            good, count = shares.sum()[bad.index.min()], shares.size()[bad.index.min()]
            beyond = f"{label(bad.index.min(), unit)}: {int(good)} of {count}"
        reach_rows.append(
            {
                "Method": method,
                "Family": family,
                "All is well up to": label(below.index.max(), unit) if len(below) else "none",
                "Beyond": beyond,
            }
        )
    return reach_rows


def wrong_in_words(frame: pd.DataFrame) -> list[str]:
    """What the twins say of wrong cells."""
    rows = frame[frame["outcome"] == WRONG]
    if not len(rows):
        return []
    caught = int(rows["marked"].sum())
    words = [
        f"{len(rows)} cells are wrong; {caught} of them no user of `predict` is given: its certificate calls the field "
        "not usable."
    ]
    return [*words, *unmarked(frame)]
