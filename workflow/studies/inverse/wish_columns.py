"""The columns of what is found for a wish."""

from pinnochio.columns import Column, number
from studies.inverse.freedom import QUANTITIES

CASE = Column("case", str, "", "patient")
OPERATION = Column(
    "operation", str, "", "what is operated: two_jaw, mandible or maxilla, with _chin a genioplasty; chin"
)
CODE = Column("code", str, "", "content hash of the code")
MOVES = (
    *(number(name, "mm", f"motion {name} of the middle of its bone", ".3f") for name in QUANTITIES[:3]),
    *(number(name, "deg", f"component {name} of the rotation vector", ".3f") for name in QUANTITIES[3:]),
)

PROPOSALS = (
    CASE,
    OPERATION,
    Column("reached", bool, "", "whether every wish is met within the limit of the configuration"),
    number("wished", "mm", "weighted root mean square of the wishes' errors before surgery", ".3f"),
    number("misfit", "mm", "the same of the face that finite elements give for the proposal", ".3f"),
    number("motion_max", "mm", "largest motion of any bone point", ".2f"),
    Column("at_bounds", str, "", "quantities that lie on a bound", optional=True),
    Column("null_space", int, "", "combinations of motions in the null space of the wish"),
    Column("solved", bool, "", "whether finite elements converged; otherwise the face is the elastic map's"),
    Column("grade", str, "", "verdict of the certificate: usable, with care, not usable"),
    Column("corrections", int, "", "finite-element solutions"),
    number("seconds", "s", "the proposal with its corrections", ".3f"),
    CODE,
)
REACHED = (
    CASE,
    OPERATION,
    Column("wish", str, "", "landmark, measure or surface that is wished"),
    Column("unit", str, "", "unit of the errors"),
    number("weight", "", "weight of the wish", ".3g"),
    number("wished", "", "how far it is off before surgery", ".3f"),
    number("error", "", "how far the proposal misses it", ".3f"),
    Column("reached", bool, "", "whether the error is within the limit of the configuration"),
    number("half_width", "of the row", "of the interval of finite elements, where calibrated", ".2f"),
)
MOTIONS = (CASE, OPERATION, Column("segment", str, "", "bone"), *MOVES)
COMBINATIONS = (
    CASE,
    OPERATION,
    Column("number", int, "", "combination of motions, the wish depending least on 1"),
    number("bone", "mm", "root mean square motion of the bones that changes the wish by the tolerance", ".2f"),
    Column("null_space", bool, "", "whether the combination lies in the null space of the wish"),
    Column("segment", str, "", "bone"),
    *MOVES,
)
