"""Which operation a virtual patient has: dealt by shares over the cohort, among those that suit the deformity."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

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
DEFORMITIES = tuple(SUITED)
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


def dealt(shares: Mapping[str, float], patients: int) -> list[Procedure]:
    """The procedures of a cohort of so many patients, whose deformities come in turn.

    shares: weights of JAWS; share of GENIOPLASTY among all and of SEGMENTAL among the cut maxillae. Each patient gets,
    among what suits its deformity, the jaws that lag farthest behind their share so far, in the cohort and among those
    of its deformity together; so the first few patients differ already, a larger cohort begins with the same ones, and
    a deformity has more than one operation. A maxilla in pieces has two and three in turn.
    """
    count: Counter = Counter()
    procedures = []
    for place in range(patients):
        turn, kind = divmod(place, len(DEFORMITIES))
        suited = [jaws for jaws in SUITED[DEFORMITIES[kind]] if shares[jaws] > 0]
        weights = [sum(shares[jaws] for jaws in rivals) for rivals in (JAWS, suited)]

        def lag(jaws, kind=kind, turn=turn, place=place, weights=weights):
            lags = shares[jaws] / weights[0] * (place + 1), shares[jaws] / weights[1] * (turn + 1)
            return lags[0] - count[jaws] + lags[1] - count[jaws, kind]

        jaws = max(suited, key=lag)
        chin = shares[GENIOPLASTY] * (place + 1) - count[GENIOPLASTY] >= 0.5
        pieces = 1
        if jaws != MANDIBLE:
            count["cut"] += 1
            if shares[SEGMENTAL] * count["cut"] - count[SEGMENTAL] >= 0.5:
                pieces = 2 + count[SEGMENTAL] % 2
        count.update([jaws, (jaws, kind), *([GENIOPLASTY] if chin else []), *([SEGMENTAL] if pieces > 1 else [])])
        procedures.append(Procedure(jaws, pieces, chin))
    return procedures
