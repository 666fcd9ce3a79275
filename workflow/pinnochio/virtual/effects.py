"""What each effect of the outcome does to the outer face when it is the only one: the price list of the truth."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, read_tables, words
from pinnochio.geometry.closest_points import closest_points
from pinnochio.geometry.interpolation import interpolate
from pinnochio.geometry.triangles import face_normals
from pinnochio.model.truth import read_truth
from pinnochio.tables.document import Block, Table, View
from pinnochio.virtual.face_scan import Scan
from pinnochio.virtual.ground_truth import CHANGE, EFFECTS, NOMINAL, OPEN, SCAN, alone, in_reality, resolve
from pinnochio.virtual.outcome import Operation, Outcome, after, change, meshed, moved, operate, photograph

REMESHED = ("nodes", "sliding_band_factor")  # effects that need a model of their own
NOTHING, EVERYTHING = "none", "all"
CASE = (
    Column("case", str, "", "patient"),
    Column("effect", str, "", "the only effect that is on"),
    Column("mean", float, "mm", "mean over the judged face", ".3f"),
    Column("p95", float, "mm", "95th percentile over it", ".3f"),
    Column("lost", float, "%", "judged face that the scan does not show", ".2f"),
)
SUMMARY = (
    Column("effect", str, "", "the only effect that is on"),
    Column("value", str, "", "its magnitude", optional=True),
    Column("n", int, "", "patients"),
    *CASE[2:],
    Column("largest", float, "mm", "largest 95th percentile of a patient", ".3f"),
    Column("source", str, "", "source of the effect", optional=True),
    Column("meaning", str, "", "what it is", optional=True),
)


class OuterFace:
    """The judged face of the nominal outcome, against which everything is measured."""

    def __init__(self, operation: Operation, nominal: Outcome):
        patient = nominal.patient
        self.operation, self.patient = operation, patient
        self.faces = patient.skin_faces[patient.face_roi]
        self.vertices = np.unique(self.faces)
        self.moved = patient.moved_skin(nominal.displacement)
        self.nominal = self.carried(patient.points, patient.cells, nominal.displacement)

    def carried(self, points: np.ndarray, cells: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Displacement (v, 3) mm that a field gives the vertices of the judged face."""
        return interpolate(self.patient.skin_points[self.vertices], points, cells, displacement)

    def difference(self, points: np.ndarray, cells: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Distance (v,) mm of the vertices from where the nominal outcome has them."""
        return np.linalg.norm(self.carried(points, cells, displacement) - self.nominal, axis=1)

    def scan_error(self, scan: Scan) -> tuple[np.ndarray, float]:
        """Distance (k,) mm of the registered scan from the nominal face, and the share of the face it lacks in %."""
        placed, _ = self.operation.registered(scan)
        near = closest_points(placed, self.moved, self.faces)
        back = closest_points(self.moved[self.faces].mean(axis=1), placed, scan.faces)
        area = face_normals(self.moved, self.faces)[1]
        return near.distance[~near.border], 100 * float(area[back.border].sum() / area.sum())


def measure(operation: Operation, truth: str) -> list[dict]:
    """Rows of :data:`CASE` of one patient: nothing on, each effect alone, everything on.

    truth: file of the outcome with all effects. Effects of the scan: distance of the registered scan, with the loss of
    face; all others: difference of displacement. Changes of the tissue stand at the dials of the reality.
    """
    off = resolve(NOMINAL)
    nominal = operate(operation, off)
    face = OuterFace(operation, nominal)

    def row(effect: str, errors: np.ndarray, lost: float = 0.0) -> dict:
        return {"case": operation.case, "effect": effect, "mean": errors.mean(), "p95": np.percentile(errors, 95),
                "lost": lost}  # fmt: skip

    rows = [row(NOTHING, *face.scan_error(photograph(operation, nominal, off)))]
    for effect in EFFECTS:
        single = alone(operation.settings.effects, effect)
        if single == off:
            continue
        if EFFECTS[effect].kind == SCAN:
            rows.append(row(effect, *face.scan_error(photograph(operation, nominal, single))))
        else:
            model = meshed(operation, single) if effect in REMESHED else nominal.patient
            if EFFECTS[effect].kind in (CHANGE, OPEN):
                changes = change(operation, single, nominal)
                field = after(nominal, changes, operation.settings.dials).displacement
            else:
                field = moved(operation, single, model).displacement
            rows.append(row(effect, face.difference(model.points, model.cells, field)))
    *everything, _ = read_truth(truth, operation.case)
    rows.append(row(EVERYTHING, face.difference(*everything)))
    return rows


def summarise(rows: pd.DataFrame, effects: Mapping[str, Any] | str, reality: str) -> pd.DataFrame:
    """One row per effect over the patients, in the order of :data:`EFFECTS`: columns of :data:`SUMMARY`."""
    values = in_reality(effects, reality)
    entries = []
    for effect in (NOTHING, *EFFECTS, EVERYTHING):
        group = rows[rows["effect"] == effect]
        if group.empty:
            continue
        about = EFFECTS.get(effect)
        entry = {"effect": effect, "n": len(group), "largest": group["p95"].max()} | dict(
            group[["mean", "p95", "lost"]].mean()
        )
        entry["value"] = f"{values[effect]:g} {about.unit}".strip() if about else ""
        entry["source"] = about.source if about else ""
        entry["meaning"] = about.meaning if about else ("registration alone" if effect == NOTHING else "every effect")
        entries.append(entry)
    return check(pd.DataFrame(entries), SUMMARY)


def tabulate(rows: Sequence[str | os.PathLike], effects: Mapping[str, Any] | str, reality: str, cohort: str) -> Table:
    """Mean of each effect over the patients' rows, with its magnitude (effects, reality: of the configuration)."""
    frame = summarise(read_tables(rows, CASE), effects, reality)
    view = [View(f"{c.name} {c.unit}".strip(), lambda row, c=c: c.text(row[c.name])) for c in SUMMARY]
    caption = (
        f"What each effect of the simulated outcome does to the outer face when it alone is on, against the nominal "
        f"outcome; {cohort}, {words(reality)}, n = {frame['n'].max()}. Effects of the scan, with expression: "
        f"distance of the registered scan from the nominal skin; all others: displacement, of which a scan sees what "
        f"does not run along the skin. Changes beyond the mechanics stand at the dials of the reality."
    )
    return Table(frame, SUMMARY, [Block.of(frame, view, caption)])
