"""What a virtual patient is and what the plan does to it, in the numbers of a cephalometric chart."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pinnochio.columns import Column, check, number, words
from pinnochio.json_text import read_stored_json
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import carriers, displacement_at
from pinnochio.tables.document import Block, Table, View
from pinnochio.virtual.head import Head
from pinnochio.virtual.parameters import TABLE, HeadParameters
from pinnochio.virtual.skeleton import Skeleton
from pinnochio.virtual.thickness import measure
from pinnochio.virtual.treatment import bite, jaw_overlap, split_overlaps


def cephalometry(s: Skeleton) -> dict[str, float]:
    """Lengths (mm) and angles (degrees) between the bony landmarks, in the sagittal plane but for widths."""

    def length(one, other):
        return float(np.linalg.norm((one - other)[1:]))

    condyle = s.condyle + [0, 0, 5]
    body, a, chin = s.menton - s.gonion, s.a_point - s.nasion, s.pogonion - s.a_point
    turn = np.arctan2(a[1], -a[2]) - np.arctan2(chin[1], -chin[2])
    return {
        "face_height": float(s.nasion[2] - s.menton[2]),
        "lower_face_height": float(s.spine[2] - s.menton[2]),
        "mandible_length": length(s.gonion, s.pogonion),
        "ramus_height": length(s.gonion, condyle),
        "effective_length": length(condyle, s.pogonion),
        "gonial_angle": s.gonial_angle,
        "mandibular_plane": float(np.degrees(np.arctan2(-body[2], -body[1]))),
        "convexity": float(np.degrees(-turn)),
        "a_point_forward": float(s.nasion[1] - s.a_point[1]),
        "pogonion_forward": float(s.nasion[1] - s.pogonion[1]),
        "chin_deviation": float(s.pogonion[0]),
        "gonial_width": float(2 * s.gonion[0]),
    }


def magnitudes(head: Head, plan: Plan) -> dict[str, float]:
    """Planned motions: of the incisor edges and of the chin (mm; forward, up, left) and of the jaws (degrees), and how
    much wider a maxilla in pieces gets between the molars (mm); of what is not cut, none."""
    s = Skeleton(head.parameters)
    sizes = {}
    for name, jaw, point in (("maxilla", "upper", s.upper_incisor), ("distal", "lower", s.lower_incisor)):
        members = carriers(head.segments, jaw)
        if members:
            left, back, up = displacement_at(plan, jaw, point[None])[0]
            turn = Rotation.from_matrix([plan.motion(segment).rotation for segment in members]).mean()
            sizes |= {f"{name}_forward": -back, f"{name}_up": up, f"{name}_left": left}
            angles = turn.as_rotvec(degrees=True)
            sizes |= {f"{name}_{axis}": angle for axis, angle in zip(("pitch", "roll", "yaw"), angles, strict=True)}
    if "chin" in head.segments:
        chin, jaw = (displacement_at(plan, name, s.pogonion[None])[0, 1] for name in ("chin", "lower"))
        sizes["chin_forward"] = jaw - chin
    if "lefort1_left" in head.segments:
        molars = [s.arch_upper[end] for end in (0, -1)]
        at = np.array([[*molar, s.upper_edge(molar[1])] for molar in molars])
        right, left = (
            plan.motion(f"lefort1_{side}").displacement(place[None])[0, 0]
            for side, place in zip(("right", "left"), at, strict=True)
        )
        sizes["maxilla_wider"] = left - right
    return {name: float(value) for name, value in sizes.items()}


def numbers(p: HeadParameters) -> dict[str, Any]:
    """The numbers of a patient, and with `scanned` its coordinates in the face model, where its skull lies, and what
    the deformity changed as it was before."""
    drawn = {name: value for name, value in asdict(p).items() if name != "scanned"}
    before = vars(p.scanned.normal)
    return drawn | {
        "scanned": {
            "identity": p.scanned.identity,
            "anchors": asdict(p.scanned.anchors),
            "normal": {name: before[name] for name in TABLE if before[name] != drawn[name]},
        }
    }


def describe(head: Head, plan: Plan) -> dict[str, Any]:
    """The sampled numbers, and what was measured: cephalometry, thickness (mm, None where no bone), bite and plan."""
    thickness = {name: None if np.isnan(value) else round(value, 2) for name, value in measure(head).items()}
    return numbers(head.parameters) | {
        "sex": "male" if head.parameters.male else "female",
        "procedure": head.procedure.name,
        "cephalometry": cephalometry(Skeleton(head.parameters)),
        "thickness": thickness,
        "plan": magnitudes(head, plan),
        "bite_before": bite(head.parameters),
        "bite_after": bite(head.parameters, plan),
        "jaw_overlap": jaw_overlap(head, plan),
        "split_overlap": split_overlaps(head, plan),
    }


_number = partial(number, form=".1f")


ANATOMY = (
    Column("case", str, "", "patient"),
    Column("sex", str, "", "female or male"),
    Column("deformity", str, "", "class of the deformity"),
    Column("procedure", str, "", "operation"),
    _number("face_height", "mm", "bony nasion to menton"),
    _number("lower_face_height", "mm", "anterior nasal spine to menton"),
    _number("mandible_length", "mm", "gonion to pogonion"),
    _number("ramus_height", "mm", "condyle to gonion"),
    _number("effective_length", "mm", "condyle to pogonion"),
    _number("gonial_angle", "degree", "condyle, gonion, pogonion"),
    _number("mandibular_plane", "degree", "gonion to menton against the Frankfort horizontal"),
    _number("convexity", "degree", "nasion, A, pogonion; positive: convex"),
    _number("a_point_forward", "mm", "A point ahead of the nasion vertical"),
    _number("pogonion_forward", "mm", "pogonion ahead of the nasion vertical"),
    _number("chin_deviation", "mm", "pogonion left of the midline"),
    _number("gonial_width", "mm", "gonion to gonion"),
    _number("overjet_before", "mm", "upper incisor edge ahead of the lower"),
    _number("open_bite_before", "mm", "incisor gap beyond the rest gap"),
    _number("midline_before", "mm", "lower incisors left of the upper"),
    _number("maxilla_forward", "mm", "plan: upper incisor edge forward; empty where the maxilla is not cut"),
    _number("maxilla_up", "mm", "plan: upper incisor edge up"),
    _number("maxilla_wider", "mm", "plan: wider between the upper molars; empty for a maxilla in one piece"),
    _number("distal_forward", "mm", "plan: lower incisor edge forward"),
    _number("distal_up", "mm", "plan: lower incisor edge up"),
    _number("distal_pitch", "degree", "plan: turn of the lower jaw, cut or not, about the transverse axis"),
    _number("distal_roll", "degree", "plan: about the sagittal axis"),
    _number("distal_yaw", "degree", "plan: about the vertical axis"),
    _number("chin_forward", "mm", "plan: chin against the jaw; empty without a genioplasty"),
    _number("overjet_after", "mm", "overjet once the plan is carried out"),
    _number("open_bite_after", "mm", "open bite once the plan is carried out"),
    _number("midline_after", "mm", "midline once the plan is carried out"),
    _number("jaw_overlap", "mm3", "upper and lower jaw in one place after the plan", form=".0f"),
    _number(
        "split_overlap", "mm3", "pieces of the mandible in one place after the plan, trimmed in surgery", form=".0f"
    ),
)


def summarise(patients: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Columns of :data:`ANATOMY`, a row for each of the patients' :func:`describe` with their `case`."""
    rows = []
    for patient in patients:
        row = patient["cephalometry"] | patient["plan"]
        for when in ("before", "after"):
            row |= {f"{name}_{when}": value for name, value in patient[f"bite_{when}"].items()}
        row |= {name: patient[name] for name in ("case", "sex", "deformity", "procedure", "jaw_overlap")}
        rows.append(row | {"split_overlap": sum(patient["split_overlap"].values())})
    return check(pd.DataFrame(rows).reindex(columns=[column.name for column in ANATOMY]), ANATOMY)


def tabulate(anatomies: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The table of the patients' anatomy files (JSON)."""
    frame = summarise([read_stored_json(path) for path in anatomies])
    view = [View(f"{words(c.name)} {c.unit}".strip(), lambda row, c=c: c.text(row[c.name])) for c in ANATOMY]
    caption = f"The patients before surgery, their plans, and the bite that the plans lead to; {cohort}."
    return Table(frame, ANATOMY, [Block.of(frame, view, caption)])
