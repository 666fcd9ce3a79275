"""Picture of the trade-off: every setting by seconds and error, six methods by name."""

import os
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from pinnochio.figures.style import BAND, MEAN, PATIENT, add_grid, label_apart, name_line, save_figure, say
from pinnochio.methods.names import BASELINE, FLOOR, in_sentence, written
from pinnochio.statistics.attainable import SMALLEST_N
from studies.tradeoff.setting_columns import TRADEOFF
from studies.tradeoff.table import as_studied

COLUMNS = TRADEOFF
STILL, NAMED = "no_change", 6
LINES = {FLOOR: ":", BASELINE: "-", STILL: "--"}
WANTED = ("fem_sliding", "pinnochio_plus", "pinnochio", "elastic", "fem_rlse", "acmt_pretrained")  # named first
FASTEST = 1e-3  # s; what takes less is drawn here
MARKS = (1e-3, 1e-2, 0.1, 1, 10, 100)  # s


def draw(frame: pd.DataFrame, paths: Sequence[str | os.PathLike]) -> None:
    """Draw rows of TRADEOFF to every path; its ending says the format.

    Six methods as in the study have names and, about their mean, the 95% interval of the paired difference to
    BASELINE; the others and every changed setting are small marks. The band holds what is not told apart from BASELINE.
    """
    sound = frame[(frame["failed"] == 0) & frame["cd"].notna()]
    base = sound[as_studied(sound)].set_index("method")
    lines = base["cd"].reindex(LINES).dropna()
    timed = sound[sound["seconds"].notna() & (sound["method"] != STILL)]
    base = base.loc[base["seconds"].notna() & (base.index != STILL)]
    order = [*(name for name in WANTED if name in base.index), *(name for name in base.index if name not in WANTED)]
    shown = base.loc[order[:NAMED]]
    ends = shown[["sliding_low", "sliding_high"]].sub(shown["sliding_difference"], axis=0).fillna(0)
    ends = ends.add(shown["cd"], axis=0).assign(seconds=shown["seconds"].clip(lower=FASTEST))
    bars = {written(name): (x, low, high) for name, low, high, x in ends.itertuples()}
    figure = Figure(figsize=(7.5, 4.8), dpi=150, layout="constrained")
    axes = figure.subplots()
    for bar in bars.values():
        axes.vlines(*bar, color=MEAN, linewidth=3, alpha=0.6)
    for rows, style in (
        (timed, {"marker": ".", "s": 34, "color": PATIENT}),
        (shown, {"marker": "D", "s": 52, "color": MEAN, "zorder": 3}),
    ):
        axes.scatter(rows["seconds"].clip(lower=FASTEST), rows["cd"], **style)
    tested = sound["n"].max() >= SMALLEST_N and sound["sliding_low"].notna().any()
    if tested:
        alike = timed.loc[(timed["sliding_low"] <= 0) & (timed["sliding_high"] >= 0), "cd"]
        axes.axhspan(alike.min(), alike.max(), color=BAND, zorder=0, label=f"not told apart from {written(BASELINE)}")
        axes.legend(frameon=False, loc="upper right", fontsize=10)
    for name, value in lines.items():
        name_line(axes, value, f"{written(name)} {value:.2f}", LINES[name])
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(MARKS))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: _spoken(seconds)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.margins(x=0.08)
    axes.set_ylim(0, 1.08 * max(timed["cd"].max(), lines.max()))
    axes.set_xlabel("one plan, warm (grey: other methods, and one setting changed)")
    axes.set_ylabel("distance of prediction and outcome, mm (Chamfer)")
    add_grid(axes)
    say(figure, _message(base, int(sound["n"].max()), tested))
    label_apart(axes, bars)
    save_figure(figure, *paths)


def _message(base: pd.DataFrame, patients: int, tested: bool) -> str:
    """What the picture says, of the methods as in the study."""
    if patients < SMALLEST_N or base.empty:
        return f"A demonstration: {patients} patients do not tell methods apart"
    best = base.loc[base["cd"].idxmin()]

    def said(row) -> str:
        return f"{row['cd']:.2f} mm in {_spoken(row['seconds'])}"

    text = f"{written(best.name)} comes nearest over {patients} patients: {said(best)}"
    if BASELINE not in base.index or best.name == BASELINE:
        return text
    text += f"; {in_sentence(BASELINE)} has {said(base.loc[BASELINE])}"
    if not tested:
        return f"{text}, not tested"
    return text + (", not told apart" if best["sliding_high"] >= 0 else ", told apart")


def _spoken(seconds: float) -> str:
    """1 ms, 55 ms, 0.1 s, 12 s."""
    if seconds < 0.0995:
        return f"{1e3 * seconds:.0f} ms"
    return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
