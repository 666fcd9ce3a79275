"""How much of the outcome's deviation from nominal mechanics could be learned from plan, anatomy and covariates."""

import os
from collections.abc import Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import Column, check, read_tables, words
from pinnochio.geometry.interpolation import interpolate
from pinnochio.geometry.triangles import vertex_areas, vertex_normals
from pinnochio.mechanics.simulation import simulate
from pinnochio.model.regions import NAMES, regions
from pinnochio.model.truth import read_truth
from pinnochio.tables.document import Block, Table, View, views
from pinnochio.virtual.aftermath import Circumstances, Site, expression
from pinnochio.virtual.ground_truth import NOMINAL, resolve
from pinnochio.virtual.outcome import Operation, meshed

REGIONS = NAMES[:6]
FACE = "face"
# What the regression reads: plan (as carried out), anatomy, covariates.
KNOWN = {
    "maxilla": "maxilla forward, mm",
    "impaction": "maxilla up, mm",
    "advance": "mandible forward, mm, zero for a setback",
    "setback": "mandible back, mm, zero for an advance",
    "upper_lip": "thickness of the upper lip, SD",
    "lower_lip": "thickness of the lower lip, SD",
    "gap": "gap of the lips, mm",
    "mass": "body mass, SD",
    "months": "months to the scan",
    "vy": "maxilla forward with V-Y closure, mm",
    "cinch": "maxilla forward with an alar cinch, mm",
}
CASE = (
    Column("case", str, "", "patient"),
    Column("region", str, "", "region of the face"),
    Column("part", int, "", "quarter of the region: 2 for its left half, plus 1 for its upper half"),
    Column("area", float, "mm2", "its skin", ".3f"),
    Column("mean", float, "mm", "mean deviation along the normal, outward", ".5f"),
    Column("square", float, "mm2", "mean square of it", ".5f"),
    *(Column(name, float, "", text, ".4f") for name, text in KNOWN.items()),
)
TABLE = (
    Column("region", str, "", "region of the face"),
    Column("n", int, "", "patients"),
    Column("rms", float, "mm", "root mean square of the deviation along the normal", ".3f"),
    Column("systematic", float, "%", "of its square that the mean over the other patients explains", ".1f"),
    Column("linear", float, "%", "of its square that a linear regression on the other patients explains", ".1f"),
    Column("left", float, "mm", "root mean square that is left after the regression", ".3f"),
)
PAPER, TER_HORST = 100 * (1 - (1.12 / 1.30) ** 2), 100 * (1 - (1.0 / 1.5) ** 2)


def known(circumstances: Circumstances) -> dict[str, float]:
    """The numbers of :data:`KNOWN` of a patient."""
    c, covariates = circumstances, circumstances.covariates
    return {
        "maxilla": c.maxilla,
        "impaction": c.impaction,
        "advance": max(c.mandible, 0.0),
        "setback": max(-c.mandible, 0.0),
        "upper_lip": c.thickness["labrale_superius"],
        "lower_lip": c.thickness["labrale_inferius"],
        "gap": c.gap,
        "mass": covariates.mass,
        "months": covariates.months,
        "vy": c.maxilla * (covariates.closure == "vy"),
        "cinch": c.maxilla * covariates.cinch,
    }


def measure(operation: Operation, truth: str) -> list[dict]:
    """Rows of :data:`CASE` of one patient: the outcome (file `truth`) as it is scanned, without the scan's noise, less
    nominal finite elements with the true motion."""
    *reached, executed = read_truth(truth, operation.case)
    patient = meshed(operation, resolve(NOMINAL))
    oracle = simulate(patient, [executed], operation.settings.fem)[0].displacement
    skin, faces = patient.skin_points, patient.skin_faces
    predicted = patient.moved_skin(oracle)
    reached = skin + interpolate(skin, *reached)
    if operation.settings.effects["expression"]:
        amount = operation.settings.effects["expression"] * operation.settings.scale
        site = Site(skin, (skin, faces), operation.landmarks)
        reached = reached + amount * expression(site, operation.draws("expression"))
    deviation = np.einsum("ij,ij->i", reached - predicted, vertex_normals(predicted, faces))
    areas = vertex_areas(skin, faces[patient.face_roi])
    numbers, codes, rows = known(operation.circumstances(executed)), regions(patient), []
    for code, name in enumerate(REGIONS):
        points = np.flatnonzero((codes == code) & (areas > 0))
        upper = skin[points, 2] > np.median(skin[points, 2])
        left = skin[points, 0] > np.median(skin[points, 0])
        for part in range(4):
            here = points[2 * left + upper == part]
            mean = np.average(deviation[here], weights=areas[here])
            square = np.average(deviation[here] ** 2, weights=areas[here])
            where = {"case": operation.case, "region": name, "part": part, "area": areas[here].sum()}
            rows.append(where | {"mean": mean, "square": square} | numbers)
    return rows


def expected(inputs: np.ndarray, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean deviation (n,) of each patient by the mean of the others and by least squares on them.

    inputs (n, k), means (n,). Least squares with an intercept, without penalty; of least norm where a number does not
    vary or patients are fewer than numbers.
    """
    flat, fitted = np.zeros(len(means)), np.zeros(len(means))
    for case in range(len(means)):
        others = np.arange(len(means)) != case
        flat[case] = means[others].mean()
        centre, spread = inputs[others].mean(axis=0), inputs[others].std(axis=0)
        scaled = (inputs - centre) / np.where(spread > 1e-9, spread, np.inf)
        weights = np.linalg.lstsq(scaled[others], means[others] - flat[case], rcond=None)[0]
        fitted[case] = flat[case] + scaled[case] @ weights
    return flat, fitted


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Columns of :data:`TABLE` by region, then for the face: left out in turn, each patient by all others."""
    sums = {}
    for (region, _), group in rows.groupby(["region", "part"], sort=False):
        group = group.sort_values("case")
        area, mean, square = (group[name].to_numpy() for name in ("area", "mean", "square"))
        for name, guess in zip(("flat", "linear"), expected(group[list(KNOWN)].to_numpy(), mean), strict=True):
            after = (area * (square - 2 * guess * mean + guess**2)).sum()
            for place in (region, FACE):
                sums.setdefault(place, dict.fromkeys(("area", "all", "flat", "linear"), 0.0))[name] += after
        for place in (region, FACE):
            sums[place]["area"] += area.sum()
            sums[place]["all"] += (area * square).sum()
    entries = []
    for place in (*REGIONS, FACE):
        total = sums[place]
        share = {name: 100 * (1 - total[name] / total["all"]) for name in ("flat", "linear")}
        entries.append(
            {"region": place, "n": rows["case"].nunique(), "rms": np.sqrt(total["all"] / total["area"]),
             "systematic": share["flat"], "linear": share["linear"],
             "left": np.sqrt(max(total["linear"], 0) / total["area"])}
        )  # fmt: skip
    return check(pd.DataFrame(entries), TABLE)


def tabulate(rows: Sequence[str | os.PathLike], cohort: str) -> Table:
    """The share by region and of the face, beside what the literature implies."""
    frame = summarise(read_tables(rows, CASE))
    view = [
        View("Region", lambda row: words(row["region"])),
        *views(
            TABLE, {"rms": "Deviation mm (RMS)", "systematic": "Mean explains %", "linear": "Regression explains %"}
        ),
        *views(TABLE, {"left": "Left mm (RMS)", "n": "n"}),
    ]
    caption = (
        f"Deviation of the outcome ({cohort}), as it is scanned but without noise, from nominal finite elements with "
        f"the true motion, along the normal; share of its square that the mean of the other patients and a linear "
        f"regression on {len(KNOWN)} numbers of plan, anatomy and covariates explain (each patient left out in turn, "
        "by quarters of regions, least squares without penalty). "
        f"Published errors imply {PAPER:.0f} % (1.30 to 1.12 mm) and {TER_HORST:.0f} % (1.5 to 1.0 mm)."
    )
    return Table(frame, TABLE, [Block.of(frame, view, caption)])
