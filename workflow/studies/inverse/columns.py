"""Columns of what is measured of the inverse."""

from pinnochio.columns import Column, number
from studies.inverse.freedom import QUANTITIES
from studies.inverse.wish_columns import CASE, CODE, OPERATION, UNITS

TASK = Column(
    "task", str, "", "what was wished: simulated (finite-element face of the plan), outcome (its scan), landmarks"
)
TOLERANCE = number("tolerance", "mm", "misfit beyond the best one within which the least motion was sought", ".4g")
RECOVERED = (
    CASE,
    TASK,
    TOLERANCE,
    Column("segment", str, "", "bone"),
    number("moved", "mm", "mean true motion of its bone: planned, or achieved", ".3f"),
    number("error", "mm", "mean distance of its bone from the true motion", ".4f"),
    number("degrees", "deg", "angle between the rotations", ".4f"),
    number("told_error", "mm", "error without the null space of the wish", ".4f"),
    number("told_degrees", "deg", "degrees without the null space of the wish", ".4f"),
    *(number(f"true_{name}", UNITS[name], f"{name} of the true motion", ".4f") for name in QUANTITIES),
)
FACES = (
    CASE,
    TASK,
    TOLERANCE,
    OPERATION,
    number("asked", "mm", "weighted root mean square of the wishes' errors before surgery", ".3f"),
    number("misfit", "mm", "the same of the finite-element face of the proposal", ".4f"),
    number("elastic_gap", "mm", "root mean square distance of that face from the elastic map's", ".3f"),
    Column("untold", int, "", "combinations of motions in the null space of the wish"),
    Column("parameters", int, "", "quantities that may change"),
    Column("bounded", int, "", "quantities that lie on a bound"),
    Column("solved", bool, "", "whether finite elements converged"),
    Column("corrections", int, "", "finite-element solutions"),
    number("seconds_elastic", "s", "the elastic proposal", ".3f"),
    number("seconds", "s", "the proposal with its corrections", ".3f"),
    Column("seed", int, "", "seed of the study"),
    CODE,
)
MARKED = (
    CASE,
    Column("place", str, "", "landmark"),
    number("moved", "mm", "way of the landmark to the outcome", ".3f"),
    number("error", "mm", "distance of the proposal's finite-element face from the outcome", ".3f"),
    number("forward_error", "mm", "distance of the achieved motion's finite-element face from the outcome", ".3f"),
)
SEEN = (
    CASE,
    TASK,
    Column("feature", int, "", "number of what a regression sees of the wished face"),
    number("value", "mm", "its value", ".5f"),
)
