"""Picture of the stability sweep: a matrix of settings and methods, coloured by outcome."""

import os
from collections.abc import Sequence

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pinnochio.experiments.stability import METHODS
from pinnochio.figures.style import save_figure
from pinnochio.tables.stability import CLEAN, CONVERGED, STABILITY, WRONG, label

COLUMNS = STABILITY
COLOURS = {CONVERGED: "#cfe8cf", CLEAN: "#f7d58b", WRONG: "#e06c60"}
ABSENT = "#eeeeee"
TITLES = {
    "translation": "jaw forward",
    "rotation": "jaw turned",
    "poisson": "Poisson's ratio",
    "stiffness": "stiffness ratio",
    "dihedral": "smallest dihedral",
    "inverted": "start inverted",
    "unit": "unit of length",
}


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw the sweep's table: rows are settings by family, columns method, element and precision.

    A cell's text is the least J of its state and the decimal exponent of its residual.
    """
    rows = list(dict.fromkeys(zip(frame["family"], frame["setting"], frame["unit"], strict=True)))
    pairs = list(dict.fromkeys(zip(frame["element"], frame["precision"], strict=True)))
    columns = [(method, *pair) for method in METHODS for pair in pairs]
    cells = {(r.family, r.setting, r.method, r.element, r.precision): r for r in frame.itertuples()}
    figure = Figure(figsize=(4 + 0.95 * len(columns), 2.2 + 0.3 * len(rows)), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    colours = np.empty((len(rows), len(columns), 3))
    for y, (family, setting, _) in enumerate(rows):
        for x, column in enumerate(columns):
            cell = cells.get((family, setting, *column))
            colours[y, x] = matplotlib.colors.to_rgb(COLOURS[cell.outcome] if cell else ABSENT)
            axes.text(x, y, text_of(cell) if cell else "–", ha="center", va="center", fontsize=9)
    axes.imshow(colours, aspect="auto", interpolation="nearest")
    axes.set_xticks(range(len(columns)), [f"{element}\n{precision}" for _, element, precision in columns], fontsize=9)
    axes.set_yticks(range(len(rows)), [label(setting, unit) for _, setting, unit in rows], fontsize=9)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.set_xticks(np.arange(len(columns)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(rows)) - 0.5, minor=True)
    axes.grid(which="minor", color="white", linewidth=1)
    axes.tick_params(which="minor", length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    place = {"xycoords": ("data", "axes fraction"), "annotation_clip": False}
    for number, method in enumerate(METHODS):
        middle = (number + 0.5) * len(pairs) - 0.5
        axes.annotate(
            method, (middle, 1), (0, 32), textcoords="offset points", ha="center", va="bottom",
            fontsize=11, fontweight="bold", **place,
        )  # fmt: skip
        if number:
            axes.axvline(number * len(pairs) - 0.5, color="black", linewidth=1.2)
    names = [family for family, _, _ in rows]
    for family in dict.fromkeys(names):
        first, count = names.index(family), names.count(family)
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
        "Text: least J of the state and exponent of the residual (loss: of its largest error, at a raw state).\n"
        "The elastic path is linear and may turn elements inside out."
    )
    save_figure(figure, *paths)


def text_of(cell) -> str:
    """Least J and exponent of the residual of a row of the table."""
    if np.isnan(cell.min_jacobian):
        return "refused"
    exponent = f"{np.floor(np.log10(cell.residual)):.0f}" if cell.residual > 0 else "0"
    power = f"1e{exponent}" if exponent != "0" else "0"
    ratio = f"{cell.min_jacobian:.2f}" if abs(cell.min_jacobian) < 100 else f"{cell.min_jacobian:.0f}"
    return f"{ratio}  {power}"
