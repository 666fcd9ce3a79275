"""The plan that a wished face asks for while somebody plans: at once by the elastic map, then by finite elements."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.freedom import freedoms
from studies.inverse.proposal import InverseSettings, propose
from studies.inverse.reading import measure_wish
from studies.inverse.wish import Marks, MeasureWish


@dataclass(frozen=True)
class Fit:
    """A plan that comes as near to the wish as its operation can.

    missed: by how much each measure is, in its unit, on the face of the elastic map or, where `verified`, of finite
    elements; met: error up to which a wish counts as met.
    """

    plan: Plan
    missed: Mapping[str, float]
    verified: bool
    met: float


class Wishing:
    """What one patient's measures are wished to be. settings: section `invert` of the configuration.

    The response of the face to every motion of bone is made with the first wish, a second once.
    """

    def __init__(self, patient: PatientModel, case: str, fem: FemSettings, settings: Mapping):
        self._patient, self._case, self._fem, self._settings = patient, case, fem, settings
        self._inverse = InverseSettings.of(settings)
        self._freedoms = freedoms(patient, settings["operations"], settings["bounds"])
        self._marks, self._face = Marks.of(patient), None

    @property
    def operations(self) -> list[str]:
        """Names of the operations that the patient's bones are cut for, the one that moves most first."""
        return list(self._freedoms)

    def wish(self, name: str, value: float) -> MeasureWish:
        """One measure (of model.measures) wished to be `value`, mm or degrees; ValueError where it cannot be."""

        def refuse(problem: str, remedy: str):
            raise ValueError(f"{problem}. {remedy[0].upper()}{remedy[1:]}")

        weight = self._settings["weights"]["measure"]
        return measure_wish(name, self._patient, self._marks, weight, refuse, value=value)

    def fits(self, wishes: Mapping[str, float], operation: str) -> Iterator[Fit]:
        """The plan by the elastic map, and the one that finite elements have corrected.

        wishes: value of each measure. ValueError without a wish, for one that cannot be, for an unknown operation, and
        where finite elements do not converge.
        """
        wish = [self.wish(name, value) for name, value in wishes.items()]
        if not wish or operation not in self._freedoms:
            raise ValueError("nothing is wished" if not wish else f"there is no operation {str(operation)[:40]!r}")
        self._face = self._face or ElasticFace(self._patient, self._fem)
        for corrections in (0, self._inverse.corrections):
            settings = replace(self._inverse, corrections=corrections)
            proposal, _ = propose(self._face, wish, self._freedoms[operation], self._case, settings)
            if corrections and not proposal.solved:
                raise ValueError("finite elements of the proposal did not converge; the elastic map's plan is kept")
            missed = {item.name: item.error(proposal.displacement) for item in wish}
            yield Fit(proposal.plan, missed, bool(corrections), self._inverse.met)
