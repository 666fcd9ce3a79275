"""Which operation a virtual patient has: dealt by shares over the cohort, among those that suit the deformity."""

from collections.abc import Mapping
from dataclasses import dataclass

from pinnochio.virtual.parameters import DEFORMITIES

BIMAXILLARY, MANDIBLE, MAXILLA = JAWS = ("bimaxillary", "mandible_only", "maxilla_only")
GENIOPLASTY, SEGMENTAL = "genioplasty", "segmental"
# Operations that may treat a deformity: a retruded or an asymmetric lower jaw is not treated in the upper one alone,
# nor an open bite in the lower one alone, which does not last [R].
SUITED = {
    "class_ii": (BIMAXILLARY, MANDIBLE),
    "class_iii": (BIMAXILLARY, MANDIBLE, MAXILLA),
    "asymmetry": (BIMAXILLARY, MANDIBLE),
    "open_bite": (BIMAXILLARY, MAXILLA),
}
PIECES = {1: ("lefort1",), 2: ("lefort1_left", "lefort1_right"), 3: ("lefort1_left", "lefort1_right", "lefort1_front")}


@dataclass(frozen=True)
class Procedure:
    """jaws: one of JAWS; pieces: 1, 2 or 3, of a maxilla that is cut; chin: whether there is a genioplasty."""

    jaws: str = BIMAXILLARY
    pieces: int = 1
    chin: bool = False

    @property
    def segments(self) -> tuple[str, ...]:
        """The bone segments that the cuts leave; a mandible that is not cut turns about its condyles as a whole."""
        upper = () if self.jaws == MANDIBLE else PIECES[self.pieces]
        lower = ("mandible",) if self.jaws == MAXILLA else ("mandible_distal", "proximal_left", "proximal_right")
        return (*upper, *lower, *(("chin",) if self.chin else ()))

    @property
    def name(self) -> str:
        """The procedure in words: bimaxillary, 2-piece maxilla, genioplasty."""
        parts = [self.jaws, *([f"{self.pieces}-piece maxilla"] if self.pieces > 1 else [])]
        return ", ".join([*parts, *([GENIOPLASTY] if self.chin else [])]).replace("_", " ")


def dealt(shares: Mapping[str, float], number: int) -> Procedure:
    """The procedure of the patient at `number` (from 0) of a cohort whose deformities come in turn.

    shares: weights of JAWS; share of GENIOPLASTY among all and of SEGMENTAL among the cut maxillae. Each patient gets,
    among what suits its deformity, the jaws that lag farthest behind their share so far, in the cohort and among those
    of its deformity together; so the first few patients differ already, a larger cohort begins with the same ones, and
    a deformity has more than one operation. A maxilla in pieces has two and three in turn.
    """
    counts = dict.fromkeys((GENIOPLASTY, SEGMENTAL, "cut"), 0)
    had: list[tuple[str, str]] = []
    for place in range(number + 1):
        deformity = DEFORMITIES[place % len(DEFORMITIES)]
        suited = [jaws for jaws in SUITED[deformity] if shares[jaws] > 0]
        lag = dict.fromkeys(suited, 0.0)
        for rivals, own in ((JAWS, had), (suited, [pair for pair in had if pair[0] == deformity])):
            total = sum(shares[jaws] for jaws in rivals)
            for jaws in suited:
                lag[jaws] += shares[jaws] / total * (len(own) + 1) - sum(pair[1] == jaws for pair in own)
        jaws = max(lag, key=lag.get)
        had.append((deformity, jaws))
        chin = shares[GENIOPLASTY] * (place + 1) - counts[GENIOPLASTY] >= 0.5
        counts[GENIOPLASTY] += chin
        pieces = 1
        if jaws != MANDIBLE:
            counts["cut"] += 1
            if shares[SEGMENTAL] * counts["cut"] - counts[SEGMENTAL] >= 0.5:
                pieces = 2 + counts[SEGMENTAL] % 2
                counts[SEGMENTAL] += 1
    return Procedure(jaws, pieces, chin)
