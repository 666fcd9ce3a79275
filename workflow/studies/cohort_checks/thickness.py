"""Soft-tissue thickness of the virtual cohort, measured on the labels, beside what the literature has."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, words
from pinnochio.json_text import read_stored_json
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.published_thickness import PUBLISHED

TABLE = (
    Column("landmark", str, "", "landmark"),
    Column("ours_mean", float, "mm", "mean of the virtual patients, measured on their labels", ".2f"),
    Column("ours_sd", float, "mm", "standard deviation of them", ".2f"),
    Column("published_mean", float, "mm", "mean of the literature", ".2f"),
    Column("published_sd", float, "mm", "standard deviation of the literature", ".2f"),
    Column("difference_sd", float, "1", "difference of the means in published standard deviations", ".2f"),
    Column("n", int, "", "patients in whom the landmark could be measured"),
    Column("source", str, "", "source of the published values"),
)


def summarise(patients: Sequence[Mapping[str, float]]) -> pd.DataFrame:
    """Columns of :data:`TABLE` over the patients' :func:`pinnochio.virtual.thickness.measure`."""
    rows = []
    for name, published in PUBLISHED.items():
        values = np.array([patient[name] for patient in patients], float)
        values = values[np.isfinite(values)]
        mean = values.mean()
        rows.append({"landmark": name, "ours_mean": mean, "ours_sd": values.std(ddof=1) if len(values) > 1 else 0.0,
                     "published_mean": published.mean, "published_sd": published.sd, "n": len(values),
                     "difference_sd": (mean - published.mean) / published.sd, "source": published.source})  # fmt: skip
    return check(pd.DataFrame(rows), TABLE)


def tabulate(anatomies: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The table of the patients' anatomy files (JSON)."""
    frame = summarise([read_stored_json(path)["thickness"] for path in anatomies])
    text = {column.name: column.text for column in TABLE}
    view = [
        View("Landmark", lambda row: words(row["landmark"])),
        View("Ours mm", lambda row: f"{text['ours_mean'](row['ours_mean'])} ± {text['ours_sd'](row['ours_sd'])}"),
        View("Published mm", lambda row: f"{row['published_mean']:.1f} ± {row['published_sd']:.1f}"),
        View("Difference in SD", lambda row: f"{row['difference_sd']:+.2f}"),
        *views(TABLE, {"n": "n", "source": "Source"}),
    ]
    caption = (
        f"Thickness of the soft tissue over bone, mean ± standard deviation, measured on the labels of the {cohort}; "
        "difference of the means in published standard deviations."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
