"""The measured Pareto front of seconds against accuracy, and the setting that it offers a new patient."""

import pandas as pd

from pinnochio.columns import Column, number
from pinnochio.errors import InputError
from pinnochio.tables.comparison import AGAINST_BASELINE

# Of the longest time measured on a patient: another one may take longer [X: docs/lab/tradeoff.md].
SAFETY = 1.5
SETTING = (
    Column("method", str, "", "method"),
    Column("parameter", str, "", "varied: nodes, element, solver, accuracy, precision, corrections, network"),
    Column("value", str, "", "what it is set to"),
    Column("recipe", str, "", "setting as JSON for a prediction; empty where none can use it", optional=True),
)
LEVEL = 0.9  # of further patients that lie within `cd_within`
TRADEOFF = (
    *SETTING,
    Column("n", int, "", "patients"),
    Column("failed", int, "", "patients without convergence"),
    number("nodes", "", "mean number of nodes", ".0f"),
    number("seconds", "s", "one plan, warm: mean of patients' medians"),
    number("seconds_max", "s", "largest of the patients' medians"),
    number("setup_seconds", "s", "mean preparation of a patient beside the mesh"),
    number("cd", "mm", "mean Chamfer distance to the outcome"),
    number("cd_sd", "mm", "standard deviation of cd"),
    number("cd_within", "mm", f"half-width about cd that holds {LEVEL:.0%} of further patients; empty below 9"),
    *AGAINST_BASELINE,
    number("face_error", "mm", "mean distance of the judged face from the reference solution"),
    number("face_error_max", "mm", "largest face_error"),
    number("volume_error", "mm", "mean distance from the reference solution over the tissue's volume"),
    number("eqres_rel", "", "mean of eqres_rel"),
    number("min_jacobian", "", "smallest volume ratio of an element", ".3f"),
    number("inverted", "", "inverted elements over all patients", ".0f"),
    Column("front_outcome", bool, "", "nothing is both faster and nearer to the outcome"),
    Column("front_reference", bool, "", "nothing is both faster and nearer to the reference solution"),
)


def choose_setting(frame: pd.DataFrame, budget_seconds: float) -> pd.Series:
    """The row of TRADEOFF to predict by: of those that can be repeated, turn no element inside out and kept the budget
    with a margin on every patient, the nearest to the outcome.

    InputError, with what can be had, if there is none.
    """
    sound = frame[(frame["recipe"] != "") & (frame["failed"] == 0) & ~(frame["inverted"] > 0)]
    offered = sound[SAFETY * sound["seconds_max"] <= budget_seconds]
    if offered.empty:
        fastest = SAFETY * sound["seconds_max"].min()
        raise InputError(
            "-",
            "tables/tradeoff.csv",
            f"no setting keeps budget_seconds {budget_seconds}",
            f"ask for {fastest:.2g} s or more",
        )
    return offered.sort_values(["cd", "seconds"]).iloc[0]
