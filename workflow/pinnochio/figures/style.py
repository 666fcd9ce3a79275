"""What the project's Matplotlib figures share."""

import os
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from pinnochio.files import replacing

EVERY = (1, 2, 5)  # times powers of ten, where a logarithmic axis has its marks


def label_log(axis: Axis, marks: Sequence[int] = EVERY, form: str = "{x:g}") -> None:
    """Plain numbers on a logarithmic axis."""
    axis.set_major_locator(LogLocator(subs=marks))
    axis.set_major_formatter(StrMethodFormatter(form))
    axis.set_minor_formatter(NullFormatter())


def add_grid(axes: Axes) -> None:
    """Thin lines behind the data."""
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def save_figure(figure: Figure, *paths: str | os.PathLike) -> None:
    """Write the figure, PNG or SVG by its ending; the same figure gives the same bytes."""
    for path in paths:
        with replacing(path) as temporary:
            figure.savefig(temporary, metadata={"Date": None} if str(path).endswith("svg") else {"Software": None})
