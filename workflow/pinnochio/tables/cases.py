"""The table of everything that is measured: one row per case and method."""

import os
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import check, read_table
from pinnochio.errors import InputError
from pinnochio.metrics.case_columns import CASES
from pinnochio.metrics.worst_point import FLAGGED, apart, read_skins
from pinnochio.tables.document import Block, Table, views


def tabulate(
    metrics: Sequence[str | os.PathLike],
    cohort: str,
    skins: Sequence[str | os.PathLike] = (),
    bounds: Collection[str] = (),
) -> Table:
    """The rows of the folds' metrics, sorted by case and method.

    skins: in the order of the metrics, where each method takes the judged skin; from them comes how far a method is
    apart from all others, but for the bounds, which are no methods.
    """
    frames = [read_table(path, CASES) for path in metrics]
    predicted: dict[str, dict[str, np.ndarray]] = {}
    for frame, path in zip(frames, skins, strict=False):
        for case, points in read_skins(path).items():
            predicted.setdefault(case, {})[frame["method"].iloc[0]] = points
    frame = pd.concat(frames, ignore_index=True)
    frame["apart"] = [
        farthest(predicted.get(case, {}), method, bounds)
        for case, method in zip(frame["case"], frame["method"], strict=True)
    ]
    frame = check(frame.sort_values(["case", "method"], kind="stable"), CASES)
    same_samples(frame)
    caption = (
        f"One row per case and method; {cohort}, {frame['case'].nunique()} patients. apart: a value above {FLAGGED:g} "
        "mm flags a prediction of which a skin point lies so far from every other method's."
    )
    return Table(frame, CASES, [Block.of(frame, views(CASES), caption)])


def farthest(skins: Mapping[str, np.ndarray], method: str, bounds: Collection[str]) -> float:
    """How far (mm) a method's skin, of a case's skins by method, is apart from those of the other methods; NaN where
    it or they are missing."""
    others = [points for name, points in skins.items() if name != method and name not in bounds]
    return apart(skins[method], others) if method in skins else np.nan


def same_samples(cases: pd.DataFrame) -> None:
    """InputError where two methods were judged by different numbers of samples of one case."""
    for name in ("target_samples", "skin_samples"):
        counts = cases.groupby("case")[name].nunique()
        if (counts > 1).any():
            raise InputError(
                counts.idxmax(), "metrics.csv", f"its methods have different {name}", "evaluate all of them again"
            )
