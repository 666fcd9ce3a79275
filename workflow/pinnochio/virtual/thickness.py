"""Soft-tissue thickness of virtual heads, measured on the labels, beside what the literature has."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from scipy import ndimage

from pinnochio.columns import Column, check, words
from pinnochio.json_text import read_stored_json
from pinnochio.model.labels import AIR, CRANIUM
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.head import Head
from pinnochio.virtual.published_thickness import PUBLISHED
from pinnochio.virtual.rays import Ray, sites
from pinnochio.virtual.skeleton import Skeleton

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
STEP = 0.1  # mm along a ray


def along_ray(head: Head, ray: Ray) -> float:
    """Distance (mm) from the first tissue to the first bone along a ray; NaN if it meets no bone.

    Borders between voxels are placed by linear interpolation of the labels' indicators.
    """
    index = ((ray.points(STEP) - head.origin) / head.spacing).T
    low = np.maximum(np.floor(index.min(1)).astype(int) - 1, 0)
    high = np.ceil(index.max(1)).astype(int) + 2
    block = head.labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    borders = []
    for inside in (block != AIR, block >= CRANIUM):
        share = ndimage.map_coordinates(inside.astype(np.float32), index - low[:, None], order=1, mode="nearest")
        hit = np.flatnonzero(share >= 0.5)
        borders.append(hit[0] if len(hit) else np.nan)
    return float((borders[1] - borders[0]) * STEP)


def measure(head: Head) -> dict[str, float]:
    """Thickness (mm) at every landmark of :data:`PUBLISHED`, mean of both sides where there are two; NaN if no bone."""
    s = Skeleton(head.parameters)
    rays = sites(s, head.landmarks)
    return {name: float(np.mean([along_ray(head, ray) for ray in rays[name]])) for name in PUBLISHED}


def summarise(patients: Sequence[Mapping[str, float]]) -> pd.DataFrame:
    """Columns of :data:`TABLE` over the patients' :func:`measure`."""
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
    patients = [read_stored_json(path)["thickness"] for path in anatomies]
    return table(summarise(patients), cohort)


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """The table of what :func:`summarise` gives."""
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
