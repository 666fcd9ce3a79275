"""Picture of a training: each loss term over the steps of both phases, with the error on the patients held back."""

import os
from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pinnochio.figures.style import save_figure
from pinnochio.methods.names import spoken

SMOOTHING = 20  # a curve is the running median over one in so many of the steps, and over as many steps at least
# Colour, line and name of each term; the lines differ in grey too.
TERMS = {
    "data": ("#1b4f8a", "-", {"pretraining": "data: volumetric error, mm²", "adaptation": "data: skin distance, mm"}),
    "physics": ("#c8553d", (0, (6, 2)), "physics: equilibrium residual"),
    "boundary": ("#4e9a60", (0, (1, 1.2)), "boundary mismatch, mm²"),
}
HELD_BACK = "#111111"
COLUMNS = ("step", *TERMS, "validation", "kept")  # of a history, as far as it is drawn


def training_picture(phases: Mapping[str, pd.DataFrame], title: str, path: str | os.PathLike) -> None:
    """Draw the loss histories of phases by their name, pretraining and adaptation, as the training writes them; a phase
    without a step, as of a network that adapts by loads alone, is not drawn."""
    phases = {phase: history for phase, history in phases.items() if len(history)}
    figure = Figure(figsize=(6.4 * len(phases), 5.2), dpi=110, layout="constrained")
    for number, (phase, history) in enumerate(phases.items()):
        axes = figure.add_subplot(1, len(phases), number + 1)
        _draw(axes, phase, history)
        axes.set_title(phase, fontsize=12, fontweight="bold")
    figure.suptitle(spoken(title), fontsize=13)
    save_figure(figure, path)


def running_median(values: np.ndarray, width: int) -> np.ndarray:
    """Median (n,) of the `width` values around each of them, of fewer at the ends."""
    return pd.Series(values).rolling(width, center=True, min_periods=1).median().to_numpy()


def _draw(axes: Axes, phase: str, history: pd.DataFrame) -> None:
    steps = history["step"].to_numpy()
    width, shown = max(SMOOTHING, len(steps) // SMOOTHING), [history["validation"]]
    for name, (colour, line, label) in TERMS.items():
        values = history[name].where(history[name] > 0).to_numpy(float)
        if np.isnan(values).all():  # a term that was left out
            continue
        axes.plot(steps, values, ".", color=colour, markersize=2, alpha=0.25, zorder=1)
        text = label if isinstance(label, str) else label[phase]
        curve = running_median(values, width)
        axes.plot(steps, curve, color=colour, linestyle=line, linewidth=2, label=text, zorder=2)
        shown.append(curve[len(curve) // 10 :])
    looked = history.dropna(subset="validation")
    if len(looked):
        points = looked["step"], looked["validation"]
        axes.plot(*points, "s-", color=HELD_BACK, markersize=5, linewidth=0.8, markerfacecolor="white",
                  label="data term of the patients held back", zorder=3)  # fmt: skip
        kept = looked[looked["kept"] == 1]
        axes.plot(kept["step"], kept["validation"], "s", color=HELD_BACK, markersize=7, zorder=4, label="weights kept")
    # The range of the curves: the residual is next to nothing in the first steps and now and then of any size.
    low, high = np.nanmin(np.concatenate(shown)), np.nanmax(np.concatenate(shown))
    axes.set_yscale("log")
    axes.set_ylim(low / 2, 2 * high)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if high < 5 * low and f"{value:e}"[0] in "25" else "")
    axes.set_xlabel("step")
    axes.set_xlim(0, max(1, steps.max()))
    axes.grid(which="major", color="#dddddd", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
