"""What the project's Matplotlib figures share."""

import os
import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pinnochio.files import replacing

MEAN, PATIENT, BAND = "#1f4e79", "#9aa5b1", "#f1e3c6"  # means, single patients, what is not told apart: also in grey
# Of a label, in points from its mark.
PLACES = [(aside, side * far) for far in (11, 24, 37) for aside in (0, -25, 25, -50, 50) for side in (1, -1)]


def add_grid(axes: Axes) -> None:
    """Thin lines behind the data."""
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def say(figure: Figure, message: str) -> None:
    """The message of the figure as its title, in lines that fit its width in inches."""
    lines = textwrap.fill(message, int(10.4 * figure.get_figwidth()))
    figure.suptitle(lines, x=0.01, ha="left", fontsize=11, weight="bold")


def name_line(axes: Axes, value: float, text: str, style: str) -> None:
    """A line across the axes with its name at their right."""
    axes.axhline(value, color="#333333", linestyle=style, linewidth=1.2, zorder=1)
    axes.annotate(text, (1.01, value), xycoords=("axes fraction", "data"), va="center", fontsize=9)


def label_apart(axes: Axes, bars: Mapping[str, tuple[float, float, float]]) -> None:
    """Texts above or below their bars (x, low, high), within the axes, none on another one or on an end of a bar.

    A thin line leads from each text to its bar.
    """
    axes.figure.draw_without_rendering()
    marks = axes.transData.transform(np.reshape([(x, y) for x, *ends in bars.values() for y in ends], (-1, 2)))
    taken = []
    for text, (x, low, high) in sorted(bars.items(), key=lambda bar: bar[1]):
        label = axes.annotate(
            text, (x, high), PLACES[0], textcoords="offset points", ha="center", va="center", fontsize=10,
            in_layout=False, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.75},
        )  # fmt: skip
        for place in PLACES:
            label.xy = (x, high if place[1] > 0 else low)
            label.set_position(place)
            box = label.get_window_extent().padded(3)
            inside = axes.bbox.x0 < box.x0 and box.x1 < axes.bbox.x1
            if inside and not box.count_contains(marks) and not box.count_overlaps(taken):
                break
        line = {"arrowstyle": "-", "linewidth": 0.8, "color": MEAN, "shrinkB": 0}
        axes.annotate("", label.xy, place, textcoords="offset points", arrowprops=line, in_layout=False, zorder=2)
        taken.append(box)


def save_figure(figure: Figure, *paths: str | os.PathLike) -> None:
    """Write the figure, PNG or SVG by its ending; the same figure gives the same bytes."""
    for path in paths:
        with replacing(path) as temporary:
            figure.savefig(temporary, metadata={"Date": None} if str(path).endswith("svg") else {"Software": None})
