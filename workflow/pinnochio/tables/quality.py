"""The table of how good every patient's model is."""

import os
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, number
from pinnochio.json_text import read_stored_json
from pinnochio.model.labels import internal_codes
from pinnochio.tables.document import Block, Table, views

_number = partial(number, form=".2f")


def quality_columns(segments: Sequence[str]) -> tuple[Column, ...]:
    """Schema of quality.csv for these bone segments."""

    bones = ("cranium", *segments)
    kinds = {bone: ("moving" if bone in segments else "fixed", "sliding", "released") for bone in bones}
    return (
        Column("case", str, "", "patient"),
        Column("muscle", str, "", "muscle layer: labelled, derived by rule, or single (none)"),
        Column("repaired_voxels", int, "", "voxels that the import repaired"),
        Column("nodes", int, "", "nodes of the mesh"),
        Column("elements", int, "", "tetrahedra"),
        Column("smallest_dihedral_deg", float, "deg", "smallest dihedral angle", ".2f"),
        Column("smallest_volume_mm3", float, "mm3", "volume of the smallest tetrahedron", ".4f"),
        Column("shortest_edge_mm", float, "mm", "shortest edge", ".3f"),
        *(_number(f"volume_{name}", "cm3", f"volume of {name}") for name in internal_codes(tuple(segments))),
        *(
            _number(f"thickness_{bone}_{key}", "mm", f"{word} of the soft tissue over {bone}")
            for bone in bones
            for key, word in (("mean", "mean"), ("p5", "5th percentile"), ("p95", "95th percentile"))
        ),
        *(
            _number(f"contact_{bone}_{kind}", "cm2", f"{kind} contact of the tissue with {bone}")
            for bone in bones
            for kind in kinds[bone]
        ),
    )


def tabulate(reports: Sequence[str | os.PathLike], segments: Sequence[str], cohort: str) -> Table:
    """One row per report of :func:`pinnochio.metrics.model_quality.quality`, sorted by case."""
    return table([read_stored_json(path) for path in reports], segments, cohort)


def table(reports: Sequence[Mapping], segments: Sequence[str], cohort: str) -> Table:
    """The same of what the files hold; columns of the segments that any of them has."""
    columns = quality_columns([name for name in segments if any(name in report["volume_cm3"] for report in reports)])
    names = [column.name for column in columns]
    rows = []
    for report in reports:
        row = {f"volume_{name}": value for name, value in report["volume_cm3"].items()}
        for what, unit in (("thickness", "mm"), ("contact", "cm2")):
            for bone, values in report[f"{what}_{unit}"].items():
                row |= {f"{what}_{bone}_{key}": value for key, value in (values or {}).items()}
        rows.append(dict.fromkeys(names, np.nan) | {key: report[key] for key in names if key in report} | row)
    frame = check(pd.DataFrame(rows).sort_values("case", kind="stable"), columns)
    caption = f"Quality of each patient's model; {cohort}, {len(frame)} patients."
    return Table(frame, columns, [Block.of(frame, views(columns), caption)])
