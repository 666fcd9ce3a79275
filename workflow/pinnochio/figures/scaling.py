"""Picture of scaling: seconds and memory of each stage against the nodes of the mesh."""

import os
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import add_grid, label_log, save_figure
from pinnochio.methods.names import spoken
from pinnochio.tables.scaling import SCALING, size_growths

COLUMNS = SCALING
# Told apart by shape and line, not by colour alone.
MARKS, LINES = "osD^vPX<>*", ("-", "--", "-.", ":")
COLOURS = ("#1f4e79", "#b5541c", "#3c7d3c", "#7a4b94", "#8c6d1f", "#444444", "#b03060")
LOOSE = 1.0  # half-width of an interval beyond which its exponent says nothing
PANELS = (("seconds", "seconds of a job, a plan or a step"), ("memory", "peak memory, MB"))


def draw(sizes: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of SCALING as marks and what is fitted to them as lines, with the exponents; one file per path."""
    grown = size_growths(sizes)
    figure = Figure(figsize=(11, 8), dpi=130, layout="constrained")
    for axes, (quantity, label) in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        for number, (stage, own) in enumerate(sizes.groupby("stage", sort=False)):
            growth = grown[stage, "nodes", quantity]
            own = own.dropna(subset=[quantity])
            colour, line = COLOURS[number % len(COLOURS)], LINES[number % len(LINES)]
            text = spoken(f"{stage}, per {own['unit'].iloc[0]}" if len(own) else stage)
            power = ": not determined"
            if growth.error <= LOOSE:
                power = f": $n^{{{growth.exponent:.2f}\\pm{growth.error:.2f}}}$"
            style = {"color": colour, "marker": MARKS[number % len(MARKS)], "markersize": 5.5}
            axes.plot(own["nodes"], own[quantity], linestyle="none", **style)
            if growth.text:
                nodes = np.geomspace(own["nodes"].min(), own["nodes"].max(), 100)
                axes.plot(nodes, growth(nodes), color=colour, linestyle=line, linewidth=1.2)
            axes.plot([], [], linestyle=line, label=text + power, **style)
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            label_log(axis, form="{x:,g}")
        axes.set_xlabel("nodes of the mesh, n")
        axes.set_ylabel(label)
        add_grid(axes)
        axes.legend(
            frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=(0, -0.1), handlelength=3.4,
            title="marks: measured; lines: constant + power of n", title_fontsize=9, alignment="left",
        )  # fmt: skip
    save_figure(figure, *paths)
