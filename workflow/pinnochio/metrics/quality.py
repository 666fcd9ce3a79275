"""How good a patient's model is: volumes, thickness, contact, elements, repairs; and the table of all patients."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.faces import EDGES
from pinnochio.geometry.triangles import vertex_areas
from pinnochio.importing.repair import repaired_voxels
from pinnochio.meshing.mesh import TetMesh
from pinnochio.model.labels import CRANIUM, internal_codes, segment_code
from pinnochio.model.patient import FIXED, FREE, MOVING, SLIDING, PatientModel
from pinnochio.tables.engine import Column, View, write_csv, write_twins

# What a contact node does; tissue at an osteotomy is released from its bone, so its nodes are free.
CONTACT = {"fixed": FIXED, "moving": MOVING, "sliding": SLIDING, "released": FREE}
TOWARDS_SKIN = 0.5  # cosine between bone normal and the way to the skin where thickness is measured [I]
BARE = 1.0  # mm of tissue that count as none


def quality(patient: PatientModel, imported: Mapping) -> dict:
    """What is known of a patient before anything is computed, as JSON holds it.

    imported: the import's report (case, muscle, volume_cm3, repairs).
    """
    mesh = TetMesh(patient.points, patient.cells, patient.tissue)
    corners = patient.points[patient.cells[:, EDGES]]
    return {
        "case": imported["case"],
        "muscle": patient.muscle,
        "repaired_voxels": repaired_voxels(imported["repairs"]),
        "repairs": imported["repairs"],
        "nodes": len(patient.points),
        "elements": len(patient.cells),
        "smallest_dihedral_deg": round(float(mesh.dihedral_angles().min()), 3),
        "smallest_volume_mm3": round(float(mesh.volumes().min()), 5),
        "shortest_edge_mm": round(float(np.linalg.norm(corners[:, :, 0] - corners[:, :, 1], axis=2).min()), 4),
        "volume_cm3": dict(imported["volume_cm3"]),
        "thickness_mm": thickness(patient),
        "contact_cm2": contact(patient),
    }


def thickness(patient: PatientModel) -> dict[str, dict[str, float] | None]:
    """Mean, 5th and 95th percentile (mm) of the soft tissue over each bone; None where no bone faces the skin.

    Measured from the bone surface's points to the nearest point of the skin, where that lies in front of the bone
    (TOWARDS_SKIN), not on the border of the skin, and at least BARE away: nearer, the skin is the bone's own surface.
    """
    found = closest_points(patient.bone_points, patient.skin_points, patient.skin_faces)
    way = found.points - patient.bone_points
    facing = np.einsum("bx,bx->b", way, patient.bone_normals) > TOWARDS_SKIN * found.distance
    facing &= (found.distance > BARE) & ~found.border
    measured = {}
    for name, index in _bones(patient):
        own = found.distance[(patient.bone_segment == index) & facing]
        low, high = np.percentile(own, [5, 95]) if len(own) else (np.nan, np.nan)
        values = {"mean": own.mean(), "p5": low, "p95": high} if len(own) else None
        measured[name] = values and {key: round(float(value), 3) for key, value in values.items()}
    return measured


def contact(patient: PatientModel) -> dict[str, dict[str, float]]:
    """Area (cm2) of the tissue's boundary on each bone, by what its nodes do; a node has a third of its triangles."""
    faces, _ = TetMesh(patient.points, patient.cells, patient.tissue).boundary_faces()
    areas = vertex_areas(patient.points, faces) / 100
    touched = {}
    for name, index in _bones(patient):
        on_bone = patient.node_beyond == (CRANIUM if index < 0 else segment_code(index))
        touched[name] = {
            kind: round(float(areas[on_bone & (patient.node_type == code)].sum()), 4)
            for kind, code in CONTACT.items()
            if (code == FIXED) == (index < 0) or code == FREE
        }
    return touched


def _bones(patient: PatientModel) -> list[tuple[str, int]]:
    return [("cranium", -1), *((name, index) for index, name in enumerate(patient.segments))]


def quality_columns(segments: Sequence[str]) -> tuple[Column, ...]:
    """Schema of quality.csv for these bone segments."""

    def number(name: str, unit: str, description: str, form: str = ".2f", optional: bool = True) -> Column:
        return Column(name, float, unit, description, form, optional)

    bones = ("cranium", *segments)
    kinds = {bone: ("moving", "sliding", "released") if bone in segments else ("fixed", "released") for bone in bones}
    return (
        Column("case", str, "", "patient"),
        Column(
            "muscle", str, "", "where the muscle layer comes from: labelled, derived (by rule) or single (no layer)"
        ),
        Column("repaired_voxels", int, "", "voxels that the import repaired"),
        Column("nodes", int, "", "nodes of the mesh"),
        Column("elements", int, "", "tetrahedra"),
        number("smallest_dihedral_deg", "deg", "smallest dihedral angle", optional=False),
        number("smallest_volume_mm3", "mm3", "volume of the smallest tetrahedron", ".4f", optional=False),
        number("shortest_edge_mm", "mm", "shortest edge", ".3f", optional=False),
        *(number(f"volume_{name}", "cm3", f"volume of {name}") for name in internal_codes(tuple(segments))),
        *(
            number(f"thickness_{bone}_{key}", "mm", f"{word} of the soft tissue over {bone}")
            for bone in bones
            for key, word in (("mean", "mean"), ("p5", "5th percentile"), ("p95", "95th percentile"))
        ),
        *(
            number(f"contact_{bone}_{kind}", "cm2", f"{kind} contact of the tissue with {bone}")
            for bone in bones
            for kind in kinds[bone]
        ),
    )


def write_quality(
    reports: Sequence[Mapping], path: str | os.PathLike, segments: Sequence[str], cohort: str = "virtual cohort"
) -> None:
    """Write quality.csv, one row per report of :func:`quality`, sorted by case, and its twins beside it."""
    schema = quality_columns(segments)
    names = [column.name for column in schema]
    rows = []
    for report in reports:
        row = {f"volume_{name}": value for name, value in report["volume_cm3"].items()}
        for what in ("thickness", "contact"):
            unit = {"thickness": "mm", "contact": "cm2"}[what]
            for bone, values in report[f"{what}_{unit}"].items():
                row |= {f"{what}_{bone}_{key}": value for key, value in (values or {}).items()}
        rows.append(dict.fromkeys(names, np.nan) | {key: report[key] for key in names if key in report} | row)
    frame = write_csv(pd.DataFrame(rows).sort_values("case", kind="stable"), path, schema)
    view = [View(f"{c.name} [{c.unit}]" if c.unit else c.name, lambda row, c=c: c.text(row[c.name])) for c in schema]
    write_twins(frame, path, view, f"Quality of each patient's model; {cohort}, {len(frame)} patients.", schema)
