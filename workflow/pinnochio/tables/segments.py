"""The table of the registered motions of the bone segments: how well each explains the scan after surgery."""

import os
from collections.abc import Sequence

import numpy as np
import pandas as pd

from pinnochio.columns import check, number, read_tables
from pinnochio.importing.segment_registration import FITS
from pinnochio.model.surfaces import BoneSurface
from pinnochio.plans.plan import Plan
from pinnochio.plans.surgery import segment_in_words
from pinnochio.tables.document import Block, Table, View

SEGMENTS = (
    *FITS,
    number("error_mean", "mm", "mean error of the surface against the simulated outcome", ".3f"),
    number("error_max", "mm", "largest error of the surface against the simulated outcome", ".3f"),
    number("error_degrees", "deg", "angle between the registered and the true motion", ".3f"),
)
GOOD_MM, GOOD_DEGREES = 0.3, 0.5  # what a registration should reach


def tabulate(
    fits: Sequence[str | os.PathLike],
    cases: Sequence[str],
    cohort: str,
    achieved: Sequence[str | os.PathLike] = (),
    executed: Sequence[str | os.PathLike] = (),
    bones: Sequence[str | os.PathLike] = (),
) -> Table:
    """One row per case and bone.

    fits: files of FITS; of a virtual cohort also the achieved and the executed plan and the bone of each case, in the
    order of `cases`; their comparison is evaluation and stands nowhere but here.
    """
    frame = read_tables(fits, FITS).assign(error_mean=np.nan, error_max=np.nan, error_degrees=np.nan)
    for case, registered, true, bone in zip(cases, achieved, executed, bones, strict=True) if executed else ():
        errors = motion_errors(Plan.read(registered, case), Plan.read(true, case), BoneSurface.read(bone))
        for name, values in errors.items():
            frame.loc[(frame["case"] == case) & (frame["segment"] == name), list(values)] = list(values.values())
    return table(frame, cohort)


def motion_errors(registered: Plan, true: Plan, bone: BoneSurface) -> dict[str, dict[str, float]]:
    """By segment of `found`: error_mean and error_max (mm) over its surface, error_degrees."""
    errors = {}
    for name, motion in registered.motions.items():
        points = bone.points[bone.segment == bone.segments.index(name)]
        off = np.linalg.norm(motion.apply(points) - true.motion(name).apply(points), axis=1)
        turned = motion.angle_from(true.motion(name))
        errors[name] = {"error_mean": off.mean(), "error_max": off.max(), "error_degrees": turned}
    return errors


def table(frame: pd.DataFrame, cohort: str) -> Table:
    """The table of the rows; the twins have one row per bone with mean ± standard deviation [largest]."""
    frame = check(frame.sort_values("case", kind="stable"), SEGMENTS)
    bones = frame.groupby("segment", sort=False)

    def spread(name):
        def text(row):
            values = bones.get_group(row["segment"])[name].dropna()
            form = next(column.format for column in SEGMENTS if column.name == name)
            numbers = (values.mean(), values.std(ddof=0), values.max())
            return "{} ± {} [{}]".format(*(format(value, form) for value in numbers)) if len(values) else ""

        return text

    shown = bones.size().rename("n").reset_index()
    judged = frame["error_max"].notna()
    view = [
        View("Bone", lambda row: segment_in_words(row["segment"])),
        View("n", lambda row: row["n"]),
        View("Median mm", spread("median")),
        View("p90 mm", spread("p90")),
        View("Matched %", spread("matched")),
        View("From plan mm", spread("from_plan")),
        View("From plan deg", spread("from_plan_degrees")),
    ]
    if judged.any():
        headers = {"error_mean": "Mean error mm", "error_max": "Largest error mm", "error_degrees": "Error deg"}
        view += [View(header, spread(name)) for name, header in headers.items()]
    caption = (
        f"Registration of the bones after surgery; {cohort}, {frame['case'].nunique()} patients: mean ± standard "
        "deviation [largest] over the patients. Median, p90, matched: the bone's surface against the scanned bone."
    )
    if judged.any():
        good = judged & (frame["error_max"] <= GOOD_MM) & (frame["error_degrees"] <= GOOD_DEGREES)
        bad = judged & ~good
        count = frame.loc[judged, "case"].nunique()
        fine = count - frame.loc[bad, "case"].nunique()
        caption += (
            f" Errors: against the true motion, over the segment's surface. All segments within {GOOD_MM:g} mm and "
            f"{GOOD_DEGREES:g} degrees: {fine} of {count} patients."
        )
    return Table(frame, SEGMENTS, [Block.of(shown, view, caption)])
