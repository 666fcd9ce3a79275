"""All plans of one patient on one page: faces that turn together, what each plan does, and the face in numbers."""

import base64
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.colors import to_hex
from plotly.offline import get_plotlyjs

from pinnochio.figures.patient import SKIN
from pinnochio.files import replacing
from pinnochio.mechanics.held_lips import CLOSING, shown_skin
from pinnochio.methods.names import written as method_name
from pinnochio.model.patient import PatientModel
from pinnochio.patients.certificate import RESEARCH
from pinnochio.patients.face_measures import written
from pinnochio.patients.prediction_page import motions_in_words
from pinnochio.plans.plan import Plan
from pinnochio.web_pages import render

TEMPLATE = "plans.html"  # beside this module; it includes plans.js
STEP = 0.01  # mm, of displacements
FARTHEST, SHADES = 10.0, 65  # mm: upper end of the colours, and how many there are


@dataclass(frozen=True)
class ComparedPlan:
    """A plan and what is predicted of it.

    page: its own page, as seen from this one; verdict: of its certificate; displacement (n, 3) mm; measures: the frame
    of patients.face.TABLE.
    """

    name: str
    plan: Plan
    page: str
    verdict: str
    displacement: np.ndarray
    measures: pd.DataFrame


def write_plans(
    case: str,
    method: str,
    patient: PatientModel,
    plans: Sequence[ComparedPlan],
    level: float | None,
    path: str | os.PathLike,
) -> None:
    """Write the page; level: of the interval, None without one."""
    colours = [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 1, SHADES))]
    used, faces = np.unique(patient.skin_faces, return_inverse=True)
    moved = [(shown_skin(patient, shown.displacement, CLOSING) - patient.skin_points)[used] for shown in plans]
    view = {
        "points": _encode(patient.skin_points[used], "<f4"),
        "faces": _encode(faces.reshape(patient.skin_faces.shape), "<i4"),
        "moved": [_encode(np.rint(shift / STEP), "<i2") for shift in moved],
        "step": STEP,
        "skin": SKIN,
        "colours": colours,
        "farthest": FARTHEST,
    }
    text = render(
        Path(__file__).with_name(TEMPLATE),
        case=case,
        method=method_name(method),
        research=RESEARCH,
        level="" if level is None else f"{100 * level:g} %",
        plans=[
            {
                "name": shown.name,
                "page": shown.page,
                "verdict": shown.verdict,
                "motions": motions_in_words(patient, shown.plan),
            }
            for shown in plans
        ],
        numbers=_numbers([shown.measures for shown in plans]),
        colours=colours[:: SHADES // 8],
        farthest=f"{FARTHEST:g}",
        view=view,
        plotly=get_plotlyjs(),
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _numbers(tables: Sequence[pd.DataFrame]) -> list[dict]:
    """The measures (without the ways of landmarks) of every plan: after, change and half-width."""
    rows = []
    for place, row in tables[0].iterrows():
        if not np.isfinite([table.loc[place, "after"] for table in tables]).any():
            continue
        digits, unit = (0, "°") if row["unit"] == "degree" else (1, "mm")
        texts = []
        for table in tables:
            width = table.loc[place, "half_width"]
            beside = f" ± {written(width, 1)}" if np.isfinite(width) else ""
            change = written(table.loc[place, "change"], 1, "+")
            texts.append(f"{written(table.loc[place, 'after'], digits)}{beside} ({change})")
        rows.append({"title": f"{row['title']}, {unit}", "before": written(row["before"], digits), "plans": texts})
    return rows


def _encode(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind)).decode()
