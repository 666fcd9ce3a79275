"""The nasolabial angle after 5 mm of maxillary advance, beside what planning software predicts for patients."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number, read_tables
from pinnochio.mechanics.simulation import simulate
from pinnochio.model.carried import carriers, columella
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan, RigidMotion
from pinnochio.plans.roles import of_role
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.ground_truth import NOMINAL, resolve
from pinnochio.virtual.outcome import Operation, meshed

ADVANCE = 5.0  # mm
# Mean and SD in degrees after the same advance [S: Modabber 2022].
PUBLISHED = {"Dolphin": (119.9, 8.6), "ProPlan": (129.5, 8.3)}
CASE = (
    Column("case", str, "", "patient"),
    Column("before", float, "degree", "nasolabial angle before surgery", ".2f"),
    Column("after", float, "degree", "after 5 mm of maxillary advance; empty if uncut", ".2f", optional=True),
)
TABLE = (
    Column("what", str, "", "whose prediction"),
    number("n", "", "patients", ".0f"),
    Column("mean", float, "degree", "mean angle", ".1f"),
    Column("sd", float, "degree", "standard deviation over patients", ".1f"),
    Column("source", str, "", "source of it", optional=True),
)


def nasolabial(patient: PatientModel, landmarks: Mapping[str, np.ndarray], displacement: np.ndarray) -> float:
    """The angle of a face under a displacement (n, 3) mm of its mesh, carried by the skin about the landmarks."""
    places = [
        columella(patient, landmarks["subnasale"], landmarks["pronasale"]),
        landmarks["subnasale"],
        landmarks["labrale_superius"],
    ]
    moved = [place + (carriers(patient, place) @ displacement)[0] for place in places]
    return MEASURES["nasolabial"].rule(np.array(moved))[0]


def measure(operation: Operation) -> list[dict]:
    """The row of :data:`CASE` of one patient, by the outcome's mechanics with all effects off.

    A maxilla that is not cut cannot be moved: then only the angle before surgery is known.
    """
    patient = meshed(operation, resolve(NOMINAL))
    forward = RigidMotion(translation=np.array([0.0, -ADVANCE, 0]))
    plan = Plan(operation.case, dict.fromkeys(of_role(operation.segments, "maxilla"), forward))
    row = {"case": operation.case, "before": nasolabial(patient, operation.landmarks, np.zeros_like(patient.points))}
    if not plan.motions:
        return [row | {"after": np.nan}]
    moved = simulate(patient, [plan], operation.settings.fem)[0].displacement
    return [row | {"after": nasolabial(patient, operation.landmarks, moved)}]


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns of :data:`TABLE`: ours after, before and the change, then the published predictions."""
    rows = rows.dropna(subset=["after"])
    ours = {"virtual cohort, after": rows["after"], "virtual cohort, before": rows["before"]}
    ours["virtual cohort, change"] = rows["after"] - rows["before"]
    entries = [
        {"what": name, "n": len(rows), "mean": values.mean(), "sd": values.std(ddof=min(1, len(rows) - 1)),
         "source": ""}
        for name, values in ours.items()
    ]  # fmt: skip
    for name, (mean, sd) in PUBLISHED.items():
        entries.append({"what": f"{name}, after", "n": np.nan, "mean": mean, "sd": sd, "source": "[S: Modabber 2022]"})
    return check(pd.DataFrame(entries), TABLE)


def tabulate(rows: Sequence[str | os.PathLike], cohort: str) -> Table:
    """Our angle beside the published ones."""
    frame = summarise(read_tables(rows, CASE))
    view = [
        *views(TABLE, {"what": "Prediction"}),
        View("Nasolabial angle", lambda row: f"{row['mean']:.1f} ± {row['sd']:.1f}"),
        *views(TABLE, {"n": "n", "source": "Source"}),
    ]
    caption = (
        "Nasolabial angle (columella, subnasale, labrale superius) in degrees after 5 mm of maxillary advance: the "
        f"same move on the first heads of the {cohort} by the outcome's mechanics without effects, and what "
        "planning software predicts for patients."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
