"""Picture of the corrections: each number of Newton corrections against sliding finite elements."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from pinnochio.figures.style import MEAN, add_grid, save_figure, say
from pinnochio.methods.names import BASELINE, in_sentence, written
from pinnochio.statistics.attainable import SMALLEST_N
from studies.corrections.table import CORRECTIONS

COLUMNS = CORRECTIONS
ROW = 0.3  # inches


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """One row per method and number of corrections: the paired difference of CD to BASELINE with its 95% interval.

    Without BASELINE in the study it is the difference to no correction. Beside it seconds and residual.
    """
    kind, other = "sliding", in_sentence(BASELINE)
    if frame["sliding_difference"].isna().all():
        kind, other = "cd", "no correction"
    frame = frame.assign(middle=frame[f"{kind}_difference"], low=frame[f"{kind}_low"], high=frame[f"{kind}_high"])
    groups = list(frame.groupby("method", sort=False))
    figure = Figure(figsize=(7.5, 1.5 + ROW * (len(frame) + 1.4 * len(groups))), dpi=150, layout="constrained")
    axes, down, ticks = figure.subplots(), 0.0, {}
    for method, rows in groups:
        axes.annotate(written(method), (0.01, down), xycoords=("axes fraction", "data"), va="center", weight="bold")
        for row in rows.itertuples():
            down += 1
            ticks[down] = row.corrections
            axes.plot([row.low, row.high], [down, down], color=MEAN, linewidth=3, alpha=0.6, solid_capstyle="butt")
            fill = "white" if pd.isna(row.low) else MEAN  # hollow without an interval
            axes.plot(row.middle, down, "o", color=MEAN, markerfacecolor=fill, markersize=7)
            for at, text in ((1.1, f"{row.seconds_mean:.2f} s"), (1.26, f"{row.eqres_rel_mean:.2g}")):
                axes.annotate(text, (at, down), xycoords=("axes fraction", "data"), va="center", ha="right")
        down += 1.4
    for at, text in ((1.1, "seconds"), (1.26, "residual")):
        axes.annotate(text, (at, -0.9), xycoords=("axes fraction", "data"), va="center", ha="right", fontsize=9)
    axes.axvline(0, color="#333333", linewidth=1.2)
    axes.annotate(other, (0, -0.9), va="center", ha="center", fontsize=9, annotation_clip=False)
    axes.set_ylim(down - 0.6, -0.6)
    axes.set_yticks(list(ticks), ticks.values())
    axes.set_ylabel("Newton corrections")
    hollow = "; hollow: no interval" if (frame["middle"].notna() & frame["low"].isna()).any() else ""
    axes.set_xlabel(f"distance to the outcome less that of {other}, mm (Chamfer, paired{hollow})")
    axes.margins(x=0.1)
    add_grid(axes)
    say(figure, _message(frame, other))
    save_figure(figure, *paths)


def _message(frame: pd.DataFrame, other: str) -> str:
    """What the picture says."""
    if frame["n"].max() < SMALLEST_N:
        return f"A demonstration: {frame['n'].max()} patients tell nothing apart"
    change = f"Corrections change the mean distance by {frame['cd_difference'].abs().max():.3f} mm at most"
    drawn, said = frame[frame["middle"].notna()], []
    if drawn["low"].isna().any():  # no claim without its interval
        return change
    for method, rows in drawn.groupby("method", sort=False):
        nearer, farther = rows["high"] < 0, rows["low"] > 0
        word = "in part told apart from"
        if nearer.all():
            word = "nearer than"
        elif farther.all():
            word = "farther than"
        elif not (nearer | farther).any():
            word = "not told apart from"
        said.append(f"{written(method)} is {word} {other}")
    return f"{change}: {', '.join(said)}"
