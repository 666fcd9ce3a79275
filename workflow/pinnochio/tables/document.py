"""What the readable twins of a table show, before it is Markdown, LaTeX or HTML."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pinnochio.columns import Column


@dataclass(frozen=True)
class View:
    """A column of the readable twins: header, text of a row, and whether large (+1) or small (-1) is best (0: none)."""

    header: str
    text: Callable
    sign: int = 0

    def bold(self, texts: Sequence[str]) -> np.ndarray:
        """Rows (n,) bool that are best as shown, all of them in a tie; none in a table of one row."""
        if not self.sign or len(texts) < 2:
            return np.zeros(len(texts), bool)
        values = self.sign * np.array([float(text.split()[0]) if text else np.nan for text in texts])
        return values == np.nanmax(values) if np.isfinite(values).any() else np.zeros(len(texts), bool)


def views(
    columns: Sequence[Column], headers: Mapping[str, str] | None = None, signs: Mapping[str, int] | None = None
) -> list[View]:
    """Columns as the CSV file writes them, under headers by their names; signs: of those in which something is best.

    Without headers: all columns, each under its name and unit.
    """
    by_name = {column.name: column for column in columns}
    headers = headers or {name: f"{name} [{c.unit}]" if c.unit else name for name, c in by_name.items()}

    def text(name):
        return lambda row: by_name[name].text(row[name])

    return [View(header, text(name), (signs or {}).get(name, 0)) for name, header in headers.items()]


def with_interval(columns: Sequence[Column], middle: str, low: str, high: str) -> Callable:
    """Text of a row: a value and, in brackets, the ends of its interval where it has one."""
    by_name = {column.name: column for column in columns}

    def text(row) -> str:
        shown, *ends = (by_name[name].text(row[name]) for name in (middle, low, high))
        return f"{shown} [{ends[0]}, {ends[1]}]" if ends[0] else shown

    return text


@dataclass(frozen=True)
class Block:
    """A table of the readable twins: headers, rows of cells (text, whether it is bold) and a caption.

    title: what sets a further table apart from the one above it.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[tuple[str, bool]]]
    caption: str
    title: str = ""

    @classmethod
    def of(cls, frame: pd.DataFrame, view: Sequence[View], caption: str, title: str = "") -> "Block":
        """The rows of a frame as a view shows them."""
        cells = []
        for column in view:
            texts = [str(column.text(row)) for row in frame.to_dict("records")]
            cells.append([(text, bool(bold and text)) for text, bold in zip(texts, column.bold(texts), strict=True)])
        return cls([column.header for column in view], list(zip(*cells, strict=True)), caption, title)


@dataclass(frozen=True)
class Table:
    """A table of the study: its rows and columns, and what the readable twins show of it.

    paragraphs: plain text below all blocks.
    """

    frame: pd.DataFrame
    columns: Sequence[Column]
    blocks: Sequence[Block]
    paragraphs: Sequence[str] = ()
