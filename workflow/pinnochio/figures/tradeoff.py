"""Picture of the trade-off: every setting by seconds and error, with the Pareto front."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import EVERY, add_grid, label_log, save_figure
from pinnochio.methods.names import spoken
from pinnochio.tables.tradeoff import FRONTS, TRADEOFF, named

COLUMNS = TRADEOFF
# Families by the beginning of a method's name, distinguished by shape, then by colour.
FAMILIES = (
    ("finite elements", ("fem",), "s", "#1f4e79"),
    ("linear elasticity", ("elastic",), "D", "#5b9bd5"),
    ("PINNOCHIO plus and its variants", ("pinnochio_plus", "design"), "o", "#b5541c"),
    ("PINNOCHIO and its variants", ("pinnochio",), "^", "#3c7d3c"),
    ("others", ("",), "x", "#666666"),
)
PANELS = {  # label of the axis and its marks; all of cd lies in little more than half a decade
    "cd": ("Chamfer distance to the outcome, mm", range(1, 10)),
    "face_error": ("mean distance of the face from the reference solution, mm", EVERY),
}
FASTEST = 1e-3  # s; what takes less is drawn here


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of TRADEOFF to every path; its ending says the format. Pareto-optimal settings are listed by number."""
    figure = Figure(figsize=(13, 7.5), dpi=130, layout="constrained")
    family = frame["method"].map(
        lambda name: next(i for i, (_, starts, *_) in enumerate(FAMILIES) if name.startswith(starts))
    )
    for axes, (error, (label, marks)) in zip(figure.subplots(1, 2), PANELS.items(), strict=True):
        sound = frame[(frame["failed"] == 0) & (frame[error] > 0)].assign(x=lambda f: f["seconds"].clip(lower=FASTEST))
        optimal = sound[sound[FRONTS[error]]].sort_values("seconds")
        axes.step(
            optimal["x"], optimal[error], where="post", color="black", linewidth=1.0, zorder=1, label="Pareto front"
        )
        for number, (name, _, mark, colour) in enumerate(FAMILIES):
            own = sound[family[sound.index] == number]
            axes.scatter(own["x"], own[error], marker=mark, s=26, color=colour, alpha=0.75, linewidth=0.9, label=name)
        names = [f"{number}  {spoken(named(row))}" for number, (_, row) in enumerate(optimal.iterrows(), 1)]
        for number, (_, row) in enumerate(optimal.iterrows(), 1):
            below = (-5, -13 if number % 2 else -22)  # where the Pareto front never runs; neighbours apart
            axes.annotate(str(number), (row["x"], row[error]), below, textcoords="offset points", ha="center")
        for column in (0, 1):
            text = "\n".join(names[column::2])
            axes.text(0.52 * column, -0.13, text, transform=axes.transAxes, va="top", fontsize=8)
        axes.set(xscale="log", yscale="log")
        label_log(axes.xaxis, (1,))
        label_log(axes.yaxis, marks)
        axes.margins(y=0.08)
        axes.set_xlabel("seconds per plan, warm")
        axes.set_ylabel(label)
        add_grid(axes)
    figure.axes[0].legend(frameon=False, fontsize=8, loc="upper right")
    save_figure(figure, *paths)
