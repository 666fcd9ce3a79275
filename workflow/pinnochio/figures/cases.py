"""Picture of all methods on the same patients: every patient's error, the mean, and its difference to the best."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import BAND, MEAN, PATIENT, save_figure, say
from pinnochio.methods.names import written
from pinnochio.metrics.case_columns import CASES, scanned
from pinnochio.statistics.ranking import Ranking, rank

COLUMNS = CASES
# Bounds and the floor are lines, not rows.
NOISE, STILL, BOUNDS = "floor_scan", "no_change", ("floor_scan", "oracle", "oracle_learner")
WIDTH, ROW = 5.2, 0.42  # inches: readable on a phone, where names stand above their rows
WIDEST = 1.35  # times the error without a prediction, where the axis ends at the latest


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """One row per method, best first: a mark for every patient, the mean, and the 95% interval of the paired difference
    to the best method, drawn from the best one's mean; a band where methods are not told apart."""
    frame = scanned(frame)
    ranking = rank(frame, [name for name in frame["method"].unique() if name not in (*BOUNDS, STILL)], seed=0)
    means, lines = ranking.means, frame.groupby("method")["cd"].mean()
    largest = max(ranking.errors.max().max(), 1.05 * lines.get(STILL, 0))
    end = 1.02 * min(largest, WIDEST * lines.get(STILL, largest))
    figure = Figure(figsize=(WIDTH, 1.6 + ROW * len(means)), dpi=150, layout="constrained")
    axes = figure.subplots()
    for row, name in enumerate(means.index):
        values = ranking.errors[name].clip(upper=end)
        axes.plot(values, [row] * len(values), "|", color=PATIENT, markersize=11, markeredgewidth=1)
        if name in ranking.against:
            test, _ = ranking.against[name]
            ends = [min(means[ranking.best] + side, end) for side in (test.low, test.high)]
            axes.plot(ends, [row, row], color=MEAN, linewidth=3, solid_capstyle="butt")
        axes.plot(min(means[name], end), row, "D" if name == ranking.best else "o", color=MEAN, markersize=8)
        text = f"{means[name]:.2f}" + (" →" if means[name] > end else "")
        axes.annotate(text, (1.01, row), xycoords=("axes fraction", "data"), va="center", fontsize=10)
        axes.annotate(
            written(name), (0, row), (2, 7), xycoords=("axes fraction", "data"), textcoords="offset points",
            fontsize=10, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
        )  # fmt: skip
    if ranking.tested:
        axes.axvspan(means.iloc[0], means[[ranking.best, *ranking.alike]].max(), color=BAND, zorder=0)
    for name, style in ((NOISE, ":"), (STILL, "--")):
        if name in lines:
            axes.axvline(lines[name], color="#333333", linestyle=style, linewidth=1.2, zorder=0)
            axes.annotate(
                f"{written(name)} {lines[name]:.2f}", (lines[name], 1.0), (0, 3), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="center", va="bottom", fontsize=9,
            )  # fmt: skip
    axes.set_yticks([])
    axes.set_ylim(len(means) - 0.6, -0.8)
    axes.set_xlim(0, end)
    axes.set_xlabel("distance of prediction and outcome, mm (Chamfer)")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.grid(axis="x", color="#e5e5e5", linewidth=0.6)
    axes.set_axisbelow(True)
    say(figure, _message(ranking))
    save_figure(figure, *paths)


def _message(ranking: Ranking) -> str:
    """What the picture says."""
    if not ranking.tested:
        return f"A demonstration: {ranking.patients} patients do not tell methods apart"
    best = f"{written(ranking.best)} comes nearest ({ranking.means.iloc[0]:.2f} mm)"
    count = len(ranking.alike)
    alike = f"; {count} other{'s are' if count > 1 else ' is'} not told apart" if count else ""
    return f"{best} over {ranking.patients} patients{alike}"
