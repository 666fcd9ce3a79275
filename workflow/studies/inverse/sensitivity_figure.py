"""Picture of which move of which bone moves which place of the face, and how far."""

import os

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pinnochio.columns import words
from pinnochio.figures.style import save_figure

LARGEST = 1.2  # mm, where the colours end


def sensitivity_figure(frame: pd.DataFrame, path: str | os.PathLike) -> None:
    """A cell for every place (rows) and every quantity of every segment (columns), of the columns of SENSITIVITY."""
    case, places = frame["case"].iloc[0], list(dict.fromkeys(frame["place"]))
    moves = list(dict.fromkeys(zip(frame["segment"], frame["quantity"], strict=True)))
    table = frame.set_index(["place", "segment", "quantity"])["moved"]
    values = np.array([[table[place, segment, quantity] for segment, quantity in moves] for place in places])
    figure = Figure(figsize=(2.4 + 0.42 * len(moves), 1.6 + 0.27 * len(places)), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(values, cmap="viridis", vmin=0, vmax=LARGEST, aspect="auto")
    for row, column in np.ndindex(values.shape):
        light = values[row, column] < 0.6 * LARGEST
        axes.text(column, row, f"{values[row, column]:.2f}", ha="center", va="center", fontsize=7,
                  color="white" if light else "black")  # fmt: skip
    axes.set_yticks(range(len(places)), [words(place) for place in places], fontsize=8)
    axes.set_xticks(range(len(moves)), [quantity for _, quantity in moves], fontsize=8, rotation=60)
    owners = [segment for segment, _ in moves]
    columns = {name: [i for i, owner in enumerate(owners) if owner == name] for name in dict.fromkeys(owners)}
    top = axes.secondary_xaxis("top")
    top.set_xticks([np.mean(numbers) for numbers in columns.values()], map(words, columns), fontsize=9)
    top.tick_params(length=0)
    for numbers in list(columns.values())[1:]:
        axes.axvline(numbers[0] - 0.5, color="white", linewidth=3)
    bar = figure.colorbar(image, ax=axes, extend="max")
    bar.set_label("mm of the face per mm or degree of the bone")
    figure.suptitle(f"{case}: which move matters where, to first order", fontsize=10)
    save_figure(figure, path)
