"""Picture of the corrections: what the seconds of Newton corrections buy, in equilibrium and in accuracy."""

import os
from collections.abc import Sequence
from itertools import cycle

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import add_grid, label_log, save_figure
from pinnochio.methods.names import written
from pinnochio.tables.corrections import CORRECTIONS

COLUMNS = CORRECTIONS
# Told apart by shape and line, not by colour alone.
STYLES = (("o", "-", "#1f4e79"), ("s", "--", "#b5541c"), ("^", ":", "#3c7d3c"), ("D", "-.", "#7a4b94"))
PANELS = (
    ("eqres_rel", "residual of the free nodes over the force of all others", True),
    ("cd", "Chamfer distance, mm", False),
)


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw the means of corrections.csv over the mean seconds; the numbers beside the marks are the corrections."""
    figure = Figure(figsize=(10, 4.4), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(PANELS), sharex=True)
    for axes, (name, label, logarithmic) in zip(panels, PANELS, strict=True):
        groups = frame.groupby("method", sort=False)
        for (method, rows), (mark, line, colour) in zip(groups, cycle(STYLES), strict=False):
            x, y = rows["seconds_mean"], rows[f"{name}_mean"]
            axes.plot(x, y, marker=mark, linestyle=line, color=colour, markersize=6, label=written(method))
            # Corrections beyond the tolerance are none: one mark carries all their numbers.
            for number, (at, same) in enumerate(rows.groupby(["seconds_mean", f"{name}_mean"], sort=False)):
                side = (6, 2) if logarithmic else (0, 7 if number % 2 == 0 else -14)
                text = ", ".join(map(str, same["corrections"]))
                axes.annotate(
                    text, at, side, textcoords="offset points", ha="left" if logarithmic else "center", fontsize=9
                )
        axes.set_xscale("log")
        axes.set_yscale("log" if logarithmic else "linear")
        label_log(axes.xaxis)
        axes.set_xlabel("seconds of network and corrections")
        axes.set_ylabel(label)
        add_grid(axes)
        axes.margins(0.1, 0.15)
    panels[0].legend(frameon=False, loc="lower left")
    save_figure(figure, *paths)
