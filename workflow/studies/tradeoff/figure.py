"""Picture of the trade-off: what a second brings a field nearer to the converged one, and a face to the outcome."""

import os
import textwrap
from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from pinnochio.figures.style import BAND, MEAN, PATIENT, add_grid, label_apart, name_line, save_figure
from pinnochio.methods.names import BASELINE, CEILING, FLOOR, in_sentence, written
from pinnochio.statistics.attainable import SMALLEST_N
from studies.tradeoff.setting_columns import TRADEOFF
from studies.tradeoff.settings import BASE

COLUMNS = TRADEOFF
STILL = "no_change"
LINES = {FLOOR: ":", CEILING: "-.", BASELINE: "-", STILL: "--"}
WANTED = ("fem_sliding", "pinnochio_plus", "pinnochio", "elastic", "pca_linear", "fem_learned", "fem_rlse")
WANTED += ("acmt_pretrained",)  # of the outcome, named
JOINED = {"nodes": "-", "accuracy": "-", "corrections": "--"}  # parameters whose settings a line joins
FASTEST = 1e-3  # s; what takes less is drawn here
MARKS = (1e-3, 1e-2, 0.1, 1, 10, 100)  # s
WIDTH = 62  # characters of a panel's message


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of TRADEOFF to every path; its ending says the format.

    Left: settings by seconds and distance of the face from the reference, a parameter's joined by a line; a ring is the
    first plan, with what the patient takes once. Right: methods as in the study and, about their mean, the 95% interval
    of the paired difference to BASELINE.
    """
    sound = frame[(frame["failed"] == 0) & frame["seconds"].notna()]
    figure = Figure(figsize=(13, 5.4), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_fields(left, sound[sound["face_error"] > 0])
    _draw_outcomes(right, frame[frame["cd"].notna()].set_index("method"))
    for axes in (left, right):
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(MARKS))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: _spoken(seconds)))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.margins(x=0.08)
        add_grid(axes)
    save_figure(figure, *paths)


def _draw_fields(axes: Axes, frame: pd.DataFrame) -> None:
    """Settings that have a distance from the reference."""
    bars, joined, usual = {}, frame[frame["parameter"].isin(JOINED)], frame[frame["value"].str.endswith(BASE)]
    for (method, parameter), rows in joined.groupby(["method", "parameter"], sort=False):
        line = pd.concat([rows, usual[usual["method"] == method]]).drop_duplicates().sort_values("seconds")
        style = {"linestyle": JOINED[parameter], "linewidth": 4 if parameter == "accuracy" else 1.2, "zorder": 3}
        axes.plot(line["seconds"].clip(lower=FASTEST), line["face_error"], color=MEAN, marker=".", **style)
    for _, row in usual.iterrows():
        first = row["seconds"] + row["setup_seconds"]
        axes.plot([row["seconds"], first], [row["face_error"]] * 2, color=PATIENT, linestyle=":", zorder=1)
        axes.plot(first, row["face_error"], "o", color=PATIENT, markerfacecolor="white", zorder=2)
        bars[written(row["method"])] = (max(row["seconds"], FASTEST), row["face_error"], row["face_error"])
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda distance, _: f"{distance:g}"))
    axes.yaxis.set_minor_formatter(FuncFormatter(lambda distance, _: f"{distance:g}"))
    axes.set_xlabel(
        "one plan, warm (ring: the first one, with factors)\nthin: nodes, thick: accuracy, dashed: corrections"
    )
    axes.set_ylabel("face: mean distance from the converged fine field, mm")
    _say(axes, _of_mesh(frame))
    axes.set_xlim(FASTEST / 2)
    label_apart(axes, bars)


def _draw_outcomes(axes: Axes, studied: pd.DataFrame) -> None:
    """Rows by method that have a distance to the outcome."""
    for name, value in studied["cd"].reindex(LINES).dropna().items():
        name_line(axes, value, f"{written(name)} {value:.2f}", LINES[name])
    timed = studied[studied["seconds"].notna() & (studied["failed"] == 0) & (studied.index != STILL)]
    seconds = timed["seconds"].clip(lower=FASTEST)
    tested = studied["n"].max() >= SMALLEST_N and timed["sliding_low"].notna().any()
    ends = timed[["sliding_low", "sliding_high"]].sub(timed["sliding_difference"], axis=0).fillna(0)
    ends = ends.add(timed["cd"], axis=0)
    axes.vlines(seconds, ends["sliding_low"], ends["sliding_high"], color=MEAN, linewidth=3, alpha=0.5)
    axes.scatter(seconds, timed["cd"], marker="D", s=30, color=MEAN, zorder=3)
    if tested:
        alike = timed.loc[(timed["sliding_low"] <= 0) & (timed["sliding_high"] >= 0), "cd"]
        axes.axhspan(alike.min(), alike.max(), color=BAND, zorder=0, label=f"not told apart from {written(BASELINE)}")
        axes.legend(frameon=False, loc="upper right", fontsize=9)
    axes.set_ylim(0, 1.08 * studied["cd"].max())
    axes.set_xlabel("one plan, warm")
    axes.set_ylabel("distance of prediction and outcome, mm (Chamfer)")
    _say(axes, _of_outcome(timed, int(studied["n"].max()), tested))
    named = [name for name in WANTED if name in timed.index]
    label_apart(axes, {written(name): (seconds[name], *ends.loc[name]) for name in named})


def _say(axes: Axes, message: str) -> None:
    axes.set_title(textwrap.fill(message, WIDTH), loc="left", fontsize=11, weight="bold")


def _of_mesh(frame: pd.DataFrame) -> str:
    """What mesh and accuracy change of the face by sliding finite elements."""
    spans = {
        parameter: rows["face_error"].max() - rows["face_error"].min()
        for parameter, rows in frame[frame["method"] == BASELINE].groupby("parameter")
    }
    if not {"nodes", "accuracy"} <= set(spans):
        return "How near a field comes to the converged one"
    return (
        f"The mesh decides how near a field comes: nodes change {in_sentence(BASELINE)} by {spans['nodes']:.2f} mm, "
        f"accuracy by {spans['accuracy']:.1g} mm"
    )


def _of_outcome(timed: pd.DataFrame, patients: int, tested: bool) -> str:
    """What the methods' distances to the outcome say."""
    if patients < SMALLEST_N or timed.empty:
        return f"A demonstration: {patients} patients do not tell methods apart"
    best = timed.loc[timed["cd"].idxmin()]

    def said(row) -> str:
        return f"{row['cd']:.2f} mm in {_spoken(row['seconds'])}"

    text = f"{written(best.name)} comes nearest over {patients} patients: {said(best)}"
    if BASELINE not in timed.index or best.name == BASELINE:
        return text
    text += f"; {in_sentence(BASELINE)} has {said(timed.loc[BASELINE])}"
    if not tested:
        return f"{text}, not tested"
    return text + (", not told apart" if best["sliding_high"] >= 0 else ", told apart")


def _spoken(seconds: float) -> str:
    """1 ms, 55 ms, 0.1 s, 12 s."""
    if seconds < 0.0995:
        return f"{1e3 * seconds:.0f} ms"
    return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
