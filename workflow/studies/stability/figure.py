"""Picture of the stability sweep: settings against methods, coloured by outcome."""

import os
from collections.abc import Sequence

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pinnochio.figures.style import save_figure
from pinnochio.methods.names import spoken
from studies.stability.table import CLEAN, CONVERGED, FAMILIES, STABILITY, WRONG, label

COLUMNS = STABILITY
COLOURS = {CONVERGED: "#cfe8cf", CLEAN: "#f7d58b", WRONG: "#e06c60"}
ABSENT = "#eeeeee"
TITLES = {
    "translation": "segment moved",
    "rotation": "segment turned",
    "rough": "set back on rough bone",
    "poisson": "Poisson's ratio",
    "stiffness": "stiffness ratio",
    "dihedral": "smallest dihedral",
    "inverted": "start inverted",
    "unit": "unit of length",
    "size": "nodes",
}


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw the sweep's table: rows are settings by family, columns methods and elements.

    A field gathers all cases, segments, ways and precisions: it is coloured in the shares of their outcomes, from the
    left, and says how many converged and, under them, the least J.
    """
    ordered = frame.sort_values("family", key=lambda group: group.map(list(FAMILIES).index), kind="stable")
    rows = []
    for family, group in ordered.groupby("family", sort=False):
        rows += [(family, setting, group["unit"].iloc[0]) for setting in sorted(group["setting"].unique())]
    columns = list(dict.fromkeys(zip(ordered["method"], ordered["element"], strict=True)))
    methods = list(dict.fromkeys(method for method, _ in columns))
    columns.sort(key=lambda column: methods.index(column[0]))
    cells = {key: group for key, group in ordered.groupby(["family", "setting", "method", "element"])}
    figure = Figure(figsize=(4 + 0.8 * len(columns), 2.5 + 0.34 * len(rows)), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    for y, (family, setting, _) in enumerate(rows):
        for x, column in enumerate(columns):
            group = cells.get((family, setting, *column))
            _paint(axes, x, y, group)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    names = [f"{spoken(method).replace(', ', chr(10))}\n{element}" for method, element in columns]
    axes.set_xticks(range(len(columns)), names, fontsize=8, rotation=60, ha="left", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), [label(setting, unit) for _, setting, unit in rows], fontsize=9)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    families = [family for family, _, _ in rows]
    for family in dict.fromkeys(families):
        first, count = families.index(family), families.count(family)
        axes.annotate(
            TITLES[family], (0, first + (count - 1) / 2), (-80, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", ha="right", va="center", fontsize=10, fontweight="bold", annotation_clip=False,
        )  # fmt: skip
        if first:
            axes.axhline(first - 0.5, color="black", linewidth=1.2)
    counts = frame["outcome"].value_counts()
    legend = [Patch(color=colour, label=f"{name} ({counts.get(name, 0)})") for name, colour in COLOURS.items()]
    figure.legend(handles=legend, loc="outside lower center", ncols=3, frameon=False, fontsize=11)
    axes.set_xlabel(
        "Text: how many of the cells converged, and their least J. Elastic path and map are linear\n"
        "and may turn elements inside out."
    )
    save_figure(figure, *paths)


def _paint(axes, x: int, y: int, group: pd.DataFrame | None) -> None:
    """One field of the picture."""
    left = x - 0.48
    if group is None:
        axes.barh(y, 0.96, 0.94, left, color=ABSENT)
        return
    for outcome, colour in COLOURS.items():
        share = 0.96 * float((group["outcome"] == outcome).mean())
        axes.barh(y, share, 0.94, left, color=matplotlib.colors.to_rgb(colour))
        left += share
    done = group[group["outcome"] == CONVERGED]
    least = done["min_jacobian"].min()
    ratio = "" if not np.isfinite(least) else f"{least:.2f}" if abs(least) < 100 else f"{least:.0f}"
    axes.text(x, y, f"{len(done)}/{len(group)}  {ratio}", ha="center", va="center", fontsize=7)
