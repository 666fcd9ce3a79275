"""Columns of the measured seconds and accuracy of every setting."""

from pinnochio.columns import Column, number
from pinnochio.tables.comparison import AGAINST_BASELINE

SETTING = (
    Column("method", str, "", "method"),
    Column("parameter", str, "", "varied: nodes, element, solver, accuracy, precision, corrections, network"),
    Column("value", str, "", "what it is set to"),
)
TRADEOFF = (
    *SETTING,
    Column("n", int, "", "patients"),
    Column("failed", int, "", "patients without convergence"),
    number("nodes", "", "mean number of nodes", ".0f"),
    number("seconds", "s", "one plan, warm: mean of patients' medians"),
    number("seconds_max", "s", "largest of the patients' medians"),
    number("setup_seconds", "s", "mean preparation of a patient beside the mesh"),
    number("cd", "mm", "mean Chamfer distance to the outcome, as the study judged it"),
    number("cd_sd", "mm", "standard deviation of cd"),
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
