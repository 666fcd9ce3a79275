"""Picture of the learning curve: error and explained share against the number of training patients."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import add_grid, save_figure
from pinnochio.methods.names import BASELINE, FLOOR, written
from studies.learning.table import LEARNING

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
HIGHEST, LOWEST = 1.7, -0.6  # times the error of finite elements, and explained share, where the axes end


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of LEARNING: means with their intervals, finite elements and the noise floor as lines.

    A mean beyond the axes is written at their edge.
    """
    panels = [(f"{name}_mean", f"{name}_low", f"{name}_high", label) for name, label in PANELS]
    panels += [("explained", "explained_low", "explained_high", "explained share of what finite elements miss")]
    panels = [panel for panel in panels if frame[panel[0]].notna().any()]
    trained, untrained = frame[frame["patients"] > 0], frame[frame["patients"] == 0].set_index("method")
    figure = Figure(figsize=(4.6 * len(panels), 4.6), dpi=130, layout="constrained")
    for axes, (middle, low, high, label) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        share = middle == "explained"
        ends = (LOWEST, 1.05) if share else (0, HIGHEST * untrained.loc[BASELINE, middle])
        for number, (method, group) in enumerate(trained.groupby("method", sort=False)):
            mark, line, colour = STYLES[number % len(STYLES)]
            x, y = group["patients"].astype(float) * SHIFT**number, group[middle]
            way = [(y - group[low]).fillna(0), (group[high] - y).fillna(0)]
            style = {"marker": mark, "linestyle": line, "color": colour, "markersize": 5.5, "capsize": 2}
            axes.errorbar(x, y, way, elinewidth=0.8, label=written(method), **style)
            edge, side = (ends[0], (0, 3)) if share else (ends[1], (0, -3))
            for at, value in zip(x, y, strict=True):
                if not ends[0] <= value <= ends[1]:
                    text = {"ha": "center", "va": "bottom" if share else "top", "fontsize": 8, "color": colour}
                    axes.annotate(f"{value:.2f}", (at, edge), side, textcoords="offset points", **text)
        for name, line in ((BASELINE, "-"), (FLOOR, ":")):
            if name in untrained.index and pd.notna(value := untrained.loc[name, middle]):
                axes.axhline(value, color="#777777", linestyle=line, linewidth=1.2, zorder=1)
                text = {"ha": "left", "fontsize": 8, "color": "#555555", "textcoords": "offset points"}
                axes.annotate(written(name), (0, value), (3, 3), xycoords=("axes fraction", "data"), **text)
        axes.set_ylim(*ends)
        axes.set_xscale("log", base=2)
        sizes = sorted(trained["patients"].unique())
        axes.set_xticks(sizes, [str(size) for size in sizes])
        axes.set_xlim(sizes[0] / 1.5, sizes[-1] * 1.4)
        axes.set_xlabel("training patients")
        axes.set_ylabel(label)
        add_grid(axes)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False)
    save_figure(figure, *paths)
