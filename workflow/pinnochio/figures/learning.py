"""Picture of the learning curve: error and explained share against the number of training patients."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import add_grid, save_figure
from pinnochio.tables.comparison import BASELINE, FLOOR
from pinnochio.tables.learning import LEARNING

COLUMNS = LEARNING
# Told apart by shape and line, not by colour alone.
STYLES = (
    ("o", "-", "#1f4e79"),
    ("s", "--", "#b5541c"),
    ("^", "-.", "#3c7d3c"),
    ("D", ":", "#7a4b94"),
    ("v", (0, (5, 1, 1, 1)), "#8c6d1f"),
    ("P", (0, (1, 1)), "#444444"),
)
PANELS = (("cd", "Chamfer distance, mm"), ("skin_error_mean", "error of the true skin, mm"))
SHIFT = 1.03  # beside each other, not one over the other


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of LEARNING: means with their intervals, finite elements and the noise floor as lines."""
    panels = [(f"{name}_mean", f"{name}_low", f"{name}_high", label) for name, label in PANELS]
    panels += [("explained", "explained_low", "explained_high", "explained share of what finite elements miss")]
    panels = [panel for panel in panels if frame[panel[0]].notna().any()]
    trained = frame[frame["patients"] > 0]
    figure = Figure(figsize=(4.6 * len(panels), 4.6), dpi=130, layout="constrained")
    for axes, (middle, low, high, label) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for number, (method, own) in enumerate(trained.groupby("method", sort=False)):
            mark, line, colour = STYLES[number % len(STYLES)]
            x = own["patients"].astype(float) * SHIFT**number
            ends = [(own[middle] - own[low]).fillna(0), (own[high] - own[middle]).fillna(0)]
            style = {"marker": mark, "linestyle": line, "color": colour, "markersize": 5.5, "capsize": 2}
            axes.errorbar(x, own[middle], ends, elinewidth=0.8, label=method, **style)
        for name, line in ((BASELINE, "-"), (FLOOR, ":")):
            value = frame.loc[frame["method"] == name, middle]
            if value.notna().any():
                axes.axhline(value.iloc[0], color="#777777", linestyle=line, linewidth=1.2, zorder=1)
                axes.annotate(
                    name, (1, value.iloc[0]), xycoords=("axes fraction", "data"), xytext=(-3, 3),
                    textcoords="offset points", ha="right", fontsize=8, color="#555555",
                )  # fmt: skip
        axes.set_xscale("log", base=2)
        sizes = sorted(trained["patients"].unique())
        axes.set_xticks(sizes, [str(size) for size in sizes])
        axes.set_xlabel("training patients")
        axes.set_ylabel(label)
        add_grid(axes)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False)
    save_figure(figure, *paths)
