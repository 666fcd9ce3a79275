"""Columns of what is measured of the inverse."""

from pinnochio.columns import Column, number
from studies.inverse.wish_columns import CASE, CODE

# What was wished: the finite-element face of the plan; the scanned outcome; the places of its landmarks.
SIMULATED, OUTCOME, LANDMARKS = TASKS = ("simulated", "outcome", "landmarks")
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
    number("misfit", "mm", "weighted root mean square of the wishes' errors on the proposal's face", ".4f"),
    number("seconds", "s", "the proposal with its corrections", ".3f"),
    CODE,
)
