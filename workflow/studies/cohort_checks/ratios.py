"""Soft-to-hard tissue ratios of the simulated outcomes: does the skin follow the bone as patients' skin does?"""

import os
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check
from pinnochio.geometry.interpolation import interpolate
from pinnochio.model.truth import read_expected, read_truth
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import displacement_at
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.aftermath import read_landmarks

FORWARD = np.array([0.0, -1.0, 0.0])
LEAST = 1.0  # mm of bone motion below which a patient says nothing about a ratio


class Ratio(NamedTuple):
    """Soft landmark, the bone landmark that it follows, the jaw that carries it (:data:`pinnochio.plans.roles.PLACES`),
    and the band of the ratio."""

    soft: str
    hard: str
    jaw: str
    low: float
    high: float
    source: str


# The bands are those of the sources, no wider: a landmark outside is said to be outside.
RATIOS = {
    "Pog'": Ratio("pogonion_soft", "pogonion_bone", "chin", 0.9, 1.0, "[R] 0.9-1.0"),
    "B'": Ratio("mentolabial", "b_point", "lower", 0.9, 1.1, "[R] about 1.0"),
    "Li": Ratio("labrale_inferius", "lower_incisor", "lower", 0.6, 0.8, "[S: PMC6173856] 0.66, [R] 0.6-0.8"),
    "Ls": Ratio("labrale_superius", "upper_incisor", "upper", 0.21, 0.7, "[S: PMC6173856] 0.21, [R] 0.4-0.7"),
    "Sn": Ratio("subnasale", "a_point", "upper", 0.4, 0.6, "[R] 0.4-0.6"),
    "Prn": Ratio("pronasale", "a_point", "upper", 0.17, 0.35, "[S: PMC6173856] 0.17, [R] 0.2-0.35"),
}
STILL, STILL_LIMIT = "glabella", 0.2  # the skin above the orbits stays where it is, mm, but for its weight
TABLE = (
    Column("ratio", str, "", "soft-tissue landmark"),
    Column("ours", float, "1", "slope through the origin of its forward motion, as decided, over the bone's", ".3f"),
    Column("whole", float, "1", "the same with what is open, which averages out over many patients", ".3f"),
    Column("low", float, "1", "lower end of the band of clinical ratios", ".2f"),
    Column("high", float, "1", "upper end of it", ".2f"),
    Column("inside", bool, "", "whether ours lies inside"),
    Column("median", float, "1", "median of the patients' own ratios", ".3f"),
    Column("n", int, "", "patients whose bone moves at least 1 mm"),
    Column("source", str, "", "source of the band"),
)


def motions(
    landmarks: Mapping[str, np.ndarray], executed: Plan, points: np.ndarray, cells: np.ndarray, displacement: np.ndarray
) -> dict[str, tuple[float, float]]:
    """Forward motion (soft, hard) in mm of each landmark pair, and of the still skin (its whole motion, 0).

    Bone that the plan does not cut stays, so that such a patient says nothing about its ratio.
    """
    soft = interpolate(np.array([landmarks[r.soft] for r in RATIOS.values()]), points, cells, displacement) @ FORWARD
    hard = [displacement_at(executed, r.jaw, landmarks[r.hard][None])[0] @ FORWARD for r in RATIOS.values()]
    still = interpolate(landmarks[STILL][None], points, cells, displacement)[0]
    pairs = {name: (float(s), float(h)) for name, s, h in zip(RATIOS, soft, hard, strict=True)}
    return pairs | {STILL: (float(np.linalg.norm(still)), 0.0)}


Motions = Mapping[str, tuple[float, float]]


def summarise(patients: Sequence[Motions], whole: Sequence[Motions]) -> pd.DataFrame:
    """Columns of :data:`TABLE` over the patients' :func:`motions`, of what is decided and as a whole; the still skin
    as its largest motion in mm."""
    rows = []
    for name, ratio in RATIOS.items():
        (soft, hard), (all_of_it, _) = (np.array([one[name] for one in of]).T for of in (patients, whole))
        moved = np.abs(hard) >= LEAST
        ours, seen = (
            float(motion[moved] @ hard[moved] / max(hard[moved] @ hard[moved], 1e-12)) for motion in (soft, all_of_it)
        )
        rows.append({"ratio": name, "ours": ours, "whole": seen, "low": ratio.low, "high": ratio.high,
                     "n": int(moved.sum()),
                     "median": float(np.median(soft[moved] / hard[moved])) if moved.any() else 0.0,
                     "inside": bool(ratio.low <= ours <= ratio.high), "source": ratio.source})  # fmt: skip
    still, seen = (np.array([one[STILL][0] for one in of]) for of in (patients, whole))
    most = float(still.max())
    rows.append({"ratio": f"{STILL} (mm)", "ours": most, "whole": float(seen.max()), "low": 0.0, "high": STILL_LIMIT,
                 "n": len(still), "median": float(np.median(still)), "inside": most <= STILL_LIMIT,
                 "source": "[I]"})  # fmt: skip
    return check(pd.DataFrame(rows), TABLE)


def tabulate(
    landmarks: Sequence[str | os.PathLike], truths: Sequence[str | os.PathLike], cases: Sequence[str], cohort: str
) -> Table:
    """Motion of the landmarks in each truth against that of the bone as operated; one row per landmark."""
    decided, whole = [], []
    for case, marks, truth in zip(cases, landmarks, truths, strict=True):
        *mesh, displacement, executed = read_truth(truth, case)
        places = read_landmarks(marks)
        for patients, field in ((decided, read_expected(truth, case)), (whole, displacement)):
            patients.append(motions(places, executed, *mesh, field))
    frame = summarise(decided, whole)
    view = [
        *views(TABLE, {"ratio": "Landmark", "ours": "Ours", "whole": "With what is open"}),
        View("Band", lambda row: f"{row['low']:.2f} to {row['high']:.2f}"),
        View("Inside", lambda row: "yes" if row["inside"] else "no"),
        *views(TABLE, {"median": "Median of patients", "n": "n", "source": "Source of the band"}),
    ]
    caption = (
        f"Soft-to-hard tissue ratios of the simulated outcomes ({cohort}), forward motion: slope through the "
        "origin over the patients; last row: largest motion of the skin above the orbits, mm."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
