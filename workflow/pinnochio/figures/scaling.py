"""Picture of scaling: seconds of each stage against the nodes of the mesh, a panel each."""

import os
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from pinnochio.figures.style import MEAN, PATIENT, add_grid, label_log, save_figure, say
from pinnochio.methods.names import spoken
from pinnochio.tables.scaling import SCALING, size_growths

COLUMNS = SCALING
STAGES = {
    "tetrahedralize": "Mesh",
    "label_interfaces": "Label interfaces",
    "simulate_fem": "Solve by FEM",
    "make_lift": "Lift",
    "pretrain": "Train",
    "predict_network": "Predict",
    "evaluate": "Evaluate",
}
LOOSE = 1.0  # half-width of an interval beyond which its exponent says nothing
ACROSS = 3  # panels


def draw(sizes: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of SCALING, one file per path: marks are measured, lines fitted; other stages in grey."""
    grown, stages = size_growths(sizes), sizes["stage"].unique()
    down = -(-len(stages) // ACROSS)
    figure = Figure(figsize=(7.5, 1.1 + 2.1 * down), dpi=150, layout="constrained")
    grid = figure.subplots(down, ACROSS, sharex=True, sharey=True, squeeze=False)
    targets = np.unique(sizes["target"])
    ticks = np.unique(targets[[0, len(targets) // 2, -1]])
    panels, curves = grid.ravel(), {}
    for stage in stages:
        nodes = sizes.loc[(sizes["stage"] == stage) & sizes["seconds"].notna(), "nodes"]
        if grown[stage, "nodes", "seconds"].text:
            curves[stage] = np.geomspace(nodes.min(), nodes.max(), 100)
    for axes, stage in zip(panels, stages, strict=False):
        own = sizes[sizes["stage"] == stage]
        for name, nodes in curves.items():
            style = (
                {"color": MEAN, "linewidth": 1.6, "zorder": 2} if name == stage else {"color": PATIENT, "alpha": 0.5}
            )
            axes.plot(nodes, grown[name, "nodes", "seconds"](nodes), **{"linewidth": 0.8} | style)
        axes.plot(own["nodes"], own["seconds"], "o", color=MEAN, markersize=5)
        growth, power = grown[stage, "nodes", "seconds"], "growth unclear"
        if growth.error <= LOOSE:
            power = f"$n^{{{growth.exponent:.1f}\\,\\pm\\,{growth.error:.1f}}}$"
        unit, memory = own["unit"].iloc[0], own["memory"].max()
        most = "" if np.isnan(memory) else f", up to {memory / 1e3:.1f} GB"
        axes.set_title(f"{_spoken(stage)}\na {unit}: {power}{most}", fontsize=9.5, loc="left")
        axes.set(xscale="log", yscale="log")
        label_log(axes.yaxis, (1,))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticks(ticks, [f"{tick:,}" for tick in ticks], fontsize=8.5)
        add_grid(axes)
    for axes in panels[len(stages) :]:
        axes.set_visible(False)
    figure.supxlabel("nodes of the mesh, n (lines: constant + power of n)", fontsize=10)
    figure.supylabel("seconds", fontsize=10)
    say(figure, _message(sizes))
    save_figure(figure, *paths)


def _message(sizes: pd.DataFrame) -> str:
    """The stages that grow most and least between the sizes that all of them have, those of one size left out."""
    table = sizes.pivot(index="stage", columns="target", values="seconds").dropna(thresh=2).dropna(axis=1)
    if table.shape[1] < 2:
        return "Too few sizes to say how seconds grow"
    grown = (table.iloc[:, -1] / table.iloc[:, 0]).sort_values()
    (least, fewer), (most, more) = grown.iloc[[0, -1]].items()
    first, last = table.columns[[0, -1]]
    return (
        f"From {first:,} to {last:,} nodes “{_spoken(most)}” takes {more:.3g} times as long, "
        f"“{_spoken(least)}” {fewer:.2g} times"
    )


def _spoken(stage: str) -> str:
    """A stage as people say it: what it does, and the method or kind that it does it for."""
    rule, *of = spoken(stage).split(" ", 1)
    return " ".join([STAGES.get(rule, rule), *of])
