"""Picture of what a registry costs: jobs, planning and memory against patients."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.columns import Column, number
from pinnochio.figures.style import MEAN, add_grid, save_figure, say

COLUMNS = (
    Column("patients", int, "", "rows of the case table"),
    number("jobs", "", "jobs of the study", ".0f"),
    number("planning", "s", "processor time of a dry run", ".1f"),
    number("planning_memory", "MB", "largest memory of the dry run", ".0f"),
    number("training_memory", "MB", "largest memory of a training", ".0f"),
)
OTHER = "#b5541c"
# Columns of each panel by its title, with what they are called, mark, line and colour.
PANELS = {
    "jobs": {"jobs": ("", "o", "-", MEAN)},
    "planning, s of a processor": {"planning": ("", "o", "-", MEAN)},
    "largest memory, MB": {
        "planning_memory": ("planning", "o", "-", MEAN),
        "training_memory": ("a training", "s", "--", OTHER),
    },
}


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of COLUMNS, every value at its point, on logarithmic axes; its ending says the format of a path."""
    figure = Figure(figsize=(11, 3.8), dpi=130, layout="constrained")
    for axes, (title, series) in zip(figure.subplots(1, len(PANELS)), PANELS.items(), strict=True):
        for name, (words, mark, line, colour) in series.items():
            rows = frame.dropna(subset=name)
            axes.plot(rows["patients"], rows[name], marker=mark, linestyle=line, color=colour, label=words)
            for at, value in zip(rows["patients"], rows[name], strict=True):
                text = f"{value:,.0f}" if value >= 100 else f"{value:.1f}"
                axes.annotate(text, (at, value), (-5, 4), textcoords="offset points", ha="right", color=colour)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(frame["patients"], [f"{patients:,}" for patients in frame["patients"]])
        axes.minorticks_off()
        axes.margins(x=0.25, y=0.15)
        axes.set_xlabel("patients")
        axes.set_ylabel(title)
        if len(series) > 1:
            axes.legend(frameon=False, loc="lower right")
        add_grid(axes)
    ends = frame.iloc[[0, -1]]
    added = ends[["planning", "planning_memory"]].diff().iloc[-1] / ends["patients"].diff().iloc[-1]
    planned = f"{1000 * added['planning']:.0f} ms and {added['planning_memory']:.1f} MB of planning"
    say(figure, f"A patient more costs {planned}")
    save_figure(figure, *paths)
